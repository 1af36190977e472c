"""CAN buses for tests: configurations, opened links, other nodes that behave as tests want."""
