"""``abbe`` in processes that can be killed, without paying for the imports each time.

One line of JSON arguments a process on standard input; its number on standard output. The processes
are forked from this one, which has no threads; what they write goes where this one's error goes.
"""

from __future__ import annotations

import json
import os
import sys

import abbe.drivers.controllers.exchange.iso_csv
import abbe.drivers.stores.modbus.store  # noqa: F401
from abbe.daemon.cli import main


def serve() -> None:
    for line in sys.stdin:
        child = os.fork()
        if not child:
            os.dup2(2, 1)
            sys.argv = ["abbe", *json.loads(line)]
            try:
                main()
            except SystemExit as done:
                os._exit(done.code if isinstance(done.code, int) else 1)
            os._exit(0)
        print(json.dumps({"pid": child}), flush=True)
        _, status = os.waitpid(child, 0)
        print(json.dumps({"status": os.waitstatus_to_exitcode(status)}), flush=True)


if __name__ == "__main__":
    serve()
