"""``make demo-fleet``: a small plant on one computer, with real engines and simulated machines."""
