"""Thermal effects: what grows, and what bends or tilts, with temperature."""
