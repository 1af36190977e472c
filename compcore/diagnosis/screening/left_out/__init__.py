"""Blocks of a campaign that are left out of a fit: what is foretold of them is what counts."""
