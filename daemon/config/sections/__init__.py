"""The sections of a configuration file, as a user writes them. ``docs/daemon.md`` is their page."""
