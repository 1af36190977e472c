"""What the workbench takes of its server and of a browser that shows it."""
