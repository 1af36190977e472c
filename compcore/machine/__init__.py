"""Machines: structure, axes, error motions by name, conditions, and the kinematics of errors.

Public: `machine.Machine`, `machine.Axis`, `conditions.Conditions`.
"""
