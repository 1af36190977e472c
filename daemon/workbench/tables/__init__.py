"""Tables in the workbench: what a controller will hold, what that leaves, and their upload."""
