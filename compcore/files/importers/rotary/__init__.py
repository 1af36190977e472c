"""Spheres on a turning table: R-tests, ball bars round it, touches by the machine's own probe."""
