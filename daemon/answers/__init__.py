"""Answers of the analysing commands: loading, progress, JSON and text."""
