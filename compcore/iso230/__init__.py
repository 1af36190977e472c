"""Evaluation by ISO 230: positioning of one axis (part 2), circles (4), diagonals (6)."""
