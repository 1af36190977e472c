"""Simulated devices: real servers over the real protocols, with a truth to compare with."""
