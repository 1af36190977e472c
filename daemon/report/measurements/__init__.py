"""Pages of measurements evaluated by a standard, or against calibrated artefacts."""
