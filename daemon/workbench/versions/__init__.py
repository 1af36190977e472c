"""Versions of a model: files, errors, two side by side, and what was done by whom."""
