"""Writing: corrected positions to the controller, who else writes them, and the last word."""
