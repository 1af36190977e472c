"""``python -m abbe.drivers.simulated DEVICE``: one file a device."""
