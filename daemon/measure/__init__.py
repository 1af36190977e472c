"""Measuring: the machine followed through a plan, instruments read, rows kept."""
