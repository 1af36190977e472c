"""Causes judged: against descriptions, by what they foretell, by what else they could be."""
