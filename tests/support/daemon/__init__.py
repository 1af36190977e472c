"""Runs, commands, uploads and links in memory for tests of the service."""
