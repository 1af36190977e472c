"""Screening: every candidate beside a fitted model, and how strongly the data speak for it."""
