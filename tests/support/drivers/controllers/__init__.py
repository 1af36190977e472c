"""Tables for tests of the controllers' dialects, and what a control makes of them."""
