"""Abbe under systemd: what it is told, and the units that start it."""
