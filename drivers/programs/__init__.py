"""Dialects of programs: the text by which a controller moves through a plan's targets."""
