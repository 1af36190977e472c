"""A simulated five-axis machine with a trunnion, its display, and an R-test in its spindle."""
