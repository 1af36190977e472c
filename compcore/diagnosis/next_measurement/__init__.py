"""Set-ups to measure next: which are practicable, and which would tell causes apart."""
