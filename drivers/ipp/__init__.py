"""I++ DME: a read-only link to coordinate measuring machines that speak it over TCP."""
