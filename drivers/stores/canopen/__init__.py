"""Compensation tables in a CANopen node."""
