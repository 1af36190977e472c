"""Bits of Abbe's status word, copied from its page ``docs/daemon.md`` and not from its code."""

RUNNING = 1 << 0
COMPENSATING = 1 << 1
X_ACTIVE = 1 << 12
Y_ACTIVE = 1 << 13
Z_ACTIVE = 1 << 14
