"""The checker and what it goes by: evidence from the wire, promises, steps, the status word."""
