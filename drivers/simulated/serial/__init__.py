"""Simulated devices that speak ASCII over a serial line."""
