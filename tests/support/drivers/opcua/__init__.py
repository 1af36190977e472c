"""An OPC UA server that is not Abbe's, and links to it."""
