"""Commands that take in maps and grids that others measured."""
