"""Residuals for the pictures of the workbench: row by row, and of many rows by cells of a picture."""
