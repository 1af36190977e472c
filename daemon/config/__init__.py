"""The daemon's configuration, format ``abbe-config/1``: sections, loading, cross checks."""

from abbe.daemon.config.configuration import Configuration
from abbe.daemon.config.load import load_config

__all__ = ["Configuration", "load_config"]
