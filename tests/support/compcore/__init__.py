"""Machines, models and campaigns for tests of the mathematics."""
