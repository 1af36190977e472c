"""``python -m abbe.daemon``: the same as ``abbe``."""

from abbe.daemon.cli import main

main()
