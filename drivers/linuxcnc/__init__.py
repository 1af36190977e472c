"""A running LinuxCNC: `link.LinuxCncLink`, entry point ``abbe.links: linuxcnc``."""
