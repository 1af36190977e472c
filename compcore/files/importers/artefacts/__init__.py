"""Measured lengths and plates of other programs: read, and as rows of a campaign."""
