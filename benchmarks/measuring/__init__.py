"""What benchmarks share: turns of two sides, seconds and memory, where figures are written."""
