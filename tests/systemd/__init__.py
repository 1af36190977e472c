"""Proofs on a real systemd: ``make test-systemd``."""
