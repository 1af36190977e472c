"""What Abbe is measured beside: bare libraries, plain NumPy, SciPy, C, black boxes, the Lasso."""
