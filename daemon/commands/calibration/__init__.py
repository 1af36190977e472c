"""Calibrating: from which measurements to a verified machine, one step after the other."""
