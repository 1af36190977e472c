"""Formulas that users write: parsed, checked for units, bounded over intervals."""
