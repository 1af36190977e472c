"""Reading: samples of all links into positions and signals that can be believed, or not."""
