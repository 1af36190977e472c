"""A Modbus bus: one connection, one request at a time, every answer checked, its units' health."""
