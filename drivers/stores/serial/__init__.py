"""Compensation tables over a serial line, as tapes."""
