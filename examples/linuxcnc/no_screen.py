#!/usr/bin/python3
"""LinuxCNC's screen where there is none: waits until it is told to end."""

import signal

signal.sigwait({signal.SIGTERM, signal.SIGINT})
