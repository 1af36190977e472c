"""The simulated bridge CMM behind an I++ DME server."""
