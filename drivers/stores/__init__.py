"""Stores: a controller's memory for compensation tables, and how they get there."""
