"""What the measuring instrument adds: laser in air, drift, offsets, the freedom of a set-up."""
