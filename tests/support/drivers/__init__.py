"""Peers and links over real protocols for tests of the drivers."""
