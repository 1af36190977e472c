"""Plans of measurements: which set-ups make the corrected machine surest in the time there is."""
