"""The store itself: connections to it, its schema, and who may do what in it."""
