"""Answers of the commands that make a model, fit it, judge it and change it."""
