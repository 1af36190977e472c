"""One owner of a machine: which resources a command holds, and the locks that hold them."""
