"""The workbench: compare, learn, add and watch in a browser on this computer, and nowhere else."""
