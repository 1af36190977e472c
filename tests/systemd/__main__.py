"""``python -m tests.systemd``: every proof, in a table with what was seen; 1 when one fails."""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from pathlib import Path

from tests.support.systemd.image import ROOT, CannotPrepareError
from tests.support.systemd.stage import stage
from tests.systemd.proofs import ALL, SHORT, prove


def main() -> int:
    """Prove, print, and keep the table below ``build/``."""
    names = [proof.__name__ for proof in ALL]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="only the proofs of a short form")
    parser.add_argument("--only", nargs="+", choices=names, metavar="PROOF", help=", ".join(names))
    parser.add_argument(
        "--container", action="store_true", help="in a container, not emulated (root only)"
    )
    given = parser.parse_args()
    chosen = [proof for proof in ALL if proof.__name__ in (given.only or names)]
    # what was started ends with this, also when it is told to end
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    began = time.monotonic()
    rows = []
    try:
        with (
            tempfile.TemporaryDirectory(prefix="abbe-machine-") as folder,
            stage(Path(folder), container=given.container) as s,
        ):
            print(f"booted after {time.monotonic() - began:.0f} s", flush=True)
            for row in prove(s, SHORT if given.short else chosen):
                print(row.words(), flush=True)
                rows.append(row)
    except CannotPrepareError as error:
        sys.stderr.write(f"make test-systemd: {error}\n")
        return 1
    failed = [row for row in rows if not row.held]
    last = f"{len(rows)} proofs, {len(failed)} failed, {time.monotonic() - began:.0f} s"
    print(last)
    table = ROOT / "build" / "systemd-proofs.txt"
    table.write_text("\n".join([*(row.words() for row in rows), last]) + "\n", encoding="utf-8")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
