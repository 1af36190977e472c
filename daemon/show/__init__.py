"""What people and programs see of a run: the live screen, plain lines, JSON lines, figures."""
