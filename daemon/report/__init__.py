"""Reports: one HTML file with its pictures inside, for any command's ``--report``."""
