"""Projection: from the error in the volume to the best tables that a controller can hold."""
