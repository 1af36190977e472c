"""drivers: the outside world, one plugin each; knows compcore's types, never the daemon."""
