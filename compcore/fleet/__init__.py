"""Machines of one type laid beside each other: what their parameters have in common, and causes."""
