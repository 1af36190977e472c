"""Abbe under systemd: what it reports, and the units that start it."""
