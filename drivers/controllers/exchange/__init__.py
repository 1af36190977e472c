"""Formats that no single controller owns: ISO/TR 16907's tables and grids, Etalon's, CMMs' maps."""
