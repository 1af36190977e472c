"""Rotary axes by R-test and ball bar, ISO 10791-6: where they lie, how they err."""
