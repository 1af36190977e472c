"""A machine's records on their way to the store, in a process of their own."""
