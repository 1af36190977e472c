"""Spheres touched by a stylus: where it touches, and the ways between, clear of the sphere."""
