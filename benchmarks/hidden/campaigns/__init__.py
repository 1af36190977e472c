"""Campaigns: exact machines measured in a shop whose temperatures wander, as files hold them."""
