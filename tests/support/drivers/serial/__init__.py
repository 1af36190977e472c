"""Serial lines for tests: configurations, opened links, devices at the other end."""
