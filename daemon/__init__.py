"""daemon: the service: configuration, pipeline, guard, live screen, command line."""
