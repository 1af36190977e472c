"""Scenes: kinds of machines with what may be hidden in them, and what their users model."""
