"""Abbe is imported once, before the first fork."""

from __future__ import annotations

import gc
import pkgutil
from importlib import import_module

import pytest


@pytest.fixture(scope="session", autouse=True)
def imported() -> None:
    """Every module that a command may import when it runs."""
    for module in pkgutil.walk_packages(import_module("abbe").__path__, "abbe."):
        if not module.name.startswith(("abbe.drivers.simulated", "abbe.daemon.__main__")):
            try:
                import_module(module.name)
            except ImportError:
                continue  # what needs a package that is not installed (LinuxCNC's own)
    gc.collect()
    gc.freeze()  # a forked process that counts references copies no pages that nobody changes
