"""A machine followed through a plan's targets, an instrument beside it read where it stands."""
