"""Answers of the commands that take in measurements, or evaluate them by a standard."""
