"""Pseudo-terminals as serial lines: a device's end, a cable between two."""
