"""MTConnect: positions and temperatures of a machine's agent, read and never written."""
