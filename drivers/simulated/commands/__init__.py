"""``python -m abbe.drivers.simulated DEVICE``: one file a device."""

OWN_FILE = {
    "serial": "ASCII devices on a serial line",
    "can": "devices on CAN",
    "controller": "a control with a memory for compensation tables",
    "bench": "the bridge CMM over Modbus with a laser beside it",
    "fleet": "many bridge CMMs over Modbus, one of which may have changed",
    "trunnion": "a five-axis machine with an R-test, on serial lines",
    "ipp": "the bridge CMM over I++ DME",
}
"""Commands with a file of their own, so that what others import does not slow them down; what each
serves, for people."""
