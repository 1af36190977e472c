"""The protocol tormentor: machines that lie, and a checker that sees only wire and time.

``python -m abbe.drivers.simulated.torment --protocol modbus-tcp --seconds 60 --seed 3`` starts a
real ``abbe run`` against a machine whose positions are known at every moment, and torments the
connection by a random script: late, split, foreign, refused, frozen. Nothing here shares code with
Abbe's drivers, so that it shares none of their assumptions. ``docs/torment.md`` is its page.

=================  =================================================================
`motion`           where the machine truly is, as a function of time
`script`, `kinds`  what goes wrong when, by a seed
`machine`          what the machine shows of itself, and what it was handed back
`loop`             one thread that waits for bytes, and knows when they can have come
`delivery`         how an answer goes out: late, in pieces, twice, not at all
`wires`            the protocols, on raw sockets and pseudo-terminals
`configuration`    the configuration and the model that ``abbe run`` is given
`judge`            the checker: the promises, judged from what was on the wire and when
`trial`            one run from beginning to end
=================  =================================================================
"""
