"""Folding: a model's effects made into tables that a live step can look up (compensator)."""
