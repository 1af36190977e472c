"""Processes beside a run: begun by it, never waited for, begun anew when they end or hang."""
