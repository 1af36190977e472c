"""Compensation maps of CMMs: their tables, squareness, convention, and the way to a model.

Public: `to_model`, `conventions.identify`.
"""
