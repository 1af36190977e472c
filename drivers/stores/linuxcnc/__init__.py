"""Compensation files of a LinuxCNC on this computer."""
