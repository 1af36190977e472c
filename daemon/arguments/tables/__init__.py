"""Arguments and options of the commands that make a controller's tables."""
