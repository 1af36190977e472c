"""Compensation tables in a controller behind Modbus."""
