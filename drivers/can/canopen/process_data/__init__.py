"""Process data objects (PDO, CiA 301) and the SYNC that triggers them."""
