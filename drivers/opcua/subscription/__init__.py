"""Subscriptions to an OPC UA server: made, followed, judged, made anew."""
