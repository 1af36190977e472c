"""Campaigns of a workbench: to choose from, sent by a browser, laid beside the model."""
