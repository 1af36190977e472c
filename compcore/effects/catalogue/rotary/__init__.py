"""Rotary axes and the spindle: average lines, error motions (ISO 230-7)."""
