"""OPC UA: positions and temperatures of controls that offer them, read and never written."""
