"""Cycles for clients of the HTTP interface: handed on by the hub, as events of a stream."""
