"""Answers of the commands that take in maps and grids that others measured."""
