"""A real LinuxCNC for tests, and links to it."""
