"""One CANopen node: setting up, keeping up, its profile, its emergencies."""
