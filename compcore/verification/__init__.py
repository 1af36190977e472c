"""Verification: lines that were not fitted, before and after, against stated tolerances."""
