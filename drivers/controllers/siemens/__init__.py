"""Siemens SINUMERIK 840D: the dialect, its archive's syntax, tables multiplied by a position."""
