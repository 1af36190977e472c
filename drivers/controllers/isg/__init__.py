"""ISG kernel and TwinCAT CNC: the dialect, axis lists, volumetric files."""
