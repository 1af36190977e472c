"""Control of a running correction: single compensations, typed-in values, datums; by its owner."""
