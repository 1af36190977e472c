"""Pages of a model: fit, comparison, diagnosis, history."""
