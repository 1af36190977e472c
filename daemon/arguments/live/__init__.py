"""Arguments and options of the commands to a correction that runs, and to who may ask it."""
