"""Check measurements by the controller while a correction runs: ``docs/check-points.md``."""
