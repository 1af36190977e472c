"""The soak: a supervised ``abbe run`` for hours, with every fault of its wire and of its computer.

The tormentor's machine and wire (`abbe.drivers.simulated.torment`) go on with fewer torments;
beside them Abbe is killed, frozen, hung, reloaded, its disk is full, slow or damaged, its clock
jumps, and clients ask without end. What the controller has is judged at every write by the same
checker.
"""
