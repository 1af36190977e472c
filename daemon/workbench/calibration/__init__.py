"""Calibrating in the workbench: the guide of ``abbe calibrate``, step by step, by clicking."""
