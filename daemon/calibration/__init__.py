"""A calibration as it is asked for, its steps, and which of them are done."""
