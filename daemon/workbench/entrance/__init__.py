"""Who may ask the workbench: the address, the door, the role, and what counts as a request."""
