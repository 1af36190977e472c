"""Many measuring machines of one type, each behind a Modbus port of its own, in one process."""
