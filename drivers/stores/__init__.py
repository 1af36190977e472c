"""Where a controller keeps its compensation tables, and how they get there."""
