"""Vendors' conventions: how a controller applies a compensation map, and finding out which."""
