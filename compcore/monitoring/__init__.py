"""Monitoring: whether a machine is still the one that its model describes, by check measurements.

Public: `charts.Charts`, `run_length.ewma_run_length`, `run_length.cusum_run_length`.
"""
