"""CAN links whose messages and signals a DBC file describes."""
