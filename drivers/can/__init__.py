"""CAN buses: raw frames by DBC file (entry point ``can``), and CANopen (``canopen``)."""
