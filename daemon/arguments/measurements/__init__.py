"""Arguments and options of the commands that take in measurements."""
