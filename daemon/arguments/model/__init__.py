"""Arguments and options of the commands that make a model."""
