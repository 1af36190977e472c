"""The HTTP interface: a process of its own that shows a run and hands on what is asked of it."""
