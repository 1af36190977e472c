"""Serial lines that speak ASCII: `link.SerialLink`, entry point ``abbe.links: serial``."""
