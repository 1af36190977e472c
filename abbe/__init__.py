"""Abbe."""
