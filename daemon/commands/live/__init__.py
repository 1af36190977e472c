"""Commands to a correction that runs."""
