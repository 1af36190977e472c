"""Campaigns with hidden causes: an exact simulator, apart from the effects' code, and scenarios."""
