"""Lines along an axis: what lasers write, and tables of runs as standards print them."""
