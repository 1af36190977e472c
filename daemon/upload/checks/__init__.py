"""Checks of an upload: bounds of tables, the controller before it, its corrections after it."""
