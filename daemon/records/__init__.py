"""Records of a machine: what was read, corrected and said, in a database that outlives a run."""
