"""Service data objects (SDO, CiA 301): reading and writing one object of a node."""
