"""What commands take that spread their work."""
