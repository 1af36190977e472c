"""Curves: the part of an error field that depends on one axis, and the best table for it."""
