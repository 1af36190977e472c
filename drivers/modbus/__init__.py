"""Modbus TCP and RTU: `link.ModbusLink`, found by the entry point ``abbe.links: modbus``."""
