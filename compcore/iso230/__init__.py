"""Evaluation by ISO 230: positioning of one axis (part 2), diagonals (part 6)."""
