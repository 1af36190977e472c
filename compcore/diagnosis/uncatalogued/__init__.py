"""What no effect of the catalogue explains: patterns in residuals, and formulas for them."""
