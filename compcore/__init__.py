"""compcore: the mathematics of machine accuracy; no clocks, no threads, no network."""
