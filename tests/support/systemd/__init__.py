"""A real systemd as process 1 of a virtual machine: its disk, the machine, who looks on."""
