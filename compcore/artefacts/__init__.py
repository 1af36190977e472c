"""Material standards of size: calibrated lengths and plates, and ISO 10360-2."""
