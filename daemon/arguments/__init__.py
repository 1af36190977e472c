"""Arguments and options of the command line, read and checked."""
