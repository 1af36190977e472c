"""Campaigns: measurements of a machine, what they cover, and what repeats say of their noise.

Public: `campaign.Campaign`, `campaign.Kind`, `noise.noise_floor`.
"""
