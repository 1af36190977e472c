"""``python -m daemon``: the same as ``abbe``."""

from daemon.cli import main

main()
