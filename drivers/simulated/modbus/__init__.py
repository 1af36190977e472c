"""A Modbus server for simulated devices: the real protocol, any registers."""
