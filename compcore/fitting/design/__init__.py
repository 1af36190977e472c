"""The design matrix: what each unknown of a model does to each measured row."""
