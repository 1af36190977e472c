"""Columns beside a fitted model: what it cannot imitate of them, and what they would explain."""
