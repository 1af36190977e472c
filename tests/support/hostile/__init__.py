"""Good files, damage by machine, and processes that are measured."""
