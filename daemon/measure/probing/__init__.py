"""Artefacts on the table that the machine touches by itself, sphere by sphere."""
