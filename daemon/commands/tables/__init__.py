"""Commands that make a controller's tables, watch them, and upload them."""
