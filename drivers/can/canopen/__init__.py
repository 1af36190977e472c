"""CANopen: encoders and temperature inputs by their profiles, any object of any node."""
