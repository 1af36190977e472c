"""The simulated moving-bridge CMM: its errors, its climate, its path, measured like a real one."""
