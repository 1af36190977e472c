"""Thermal days of a machine tool, simulated apart from Abbe: bodies, weather, work, a day's rig."""
