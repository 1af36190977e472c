"""Sparkplug B 3.0 (ISO/IEC 20237): a run as an edge node, its machine as a device of it."""
