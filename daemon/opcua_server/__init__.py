"""What a run offers by OPC UA: made in the run, served by a process of its own, read-only."""
