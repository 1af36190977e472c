"""What goes between a run and its HTTP process: messages over a socket pair, packed cycles."""
