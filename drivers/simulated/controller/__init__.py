"""A simulated control with a memory for compensation tables, over Modbus, CANopen and serial."""
