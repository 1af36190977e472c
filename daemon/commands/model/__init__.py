"""Commands that make a model, fit it, judge it and change it."""
