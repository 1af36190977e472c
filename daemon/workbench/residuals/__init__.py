"""Residuals for the workbench's pictures: row by row, and of many rows by cells of a picture."""
