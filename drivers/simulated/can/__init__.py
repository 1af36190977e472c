"""A simulated CAN bus: its wire, its adapter, CANopen nodes and devices of a DBC file."""
