"""The commands of ``docs/install.md``, as a reader types them: what is proved stands there."""

from __future__ import annotations

import re

from tests.support.systemd.image import ROOT

PAGE = ROOT / "docs" / "install.md"
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NOT_HERE = {
    "sudo python3 -m venv /opt/abbe": "an index of Python packages is not within reach",
    "sudo /opt/abbe/bin/pip install abbe": "the same",
    "sudo /opt/abbe/bin/abbe service install mill-7/config.toml --name mill-7": "the same",
    "/opt/abbe/bin/pip freeze > abbe-before.txt": "the same",
    "sudo /opt/abbe/bin/pip install --upgrade abbe": "the same",
    "sudo /opt/abbe/bin/abbe service renew --restart": "the same",
    "sudo /opt/abbe/bin/pip install -r abbe-before.txt": "the same",
    "sudo systemctl edit abbe@mill-7": "a person edits",
    "sudo systemctl enable --now systemd-networkd": "the machine's kernel has no CAN",
    "networkctl status can0": "the machine's kernel has no CAN",
}
"""Commands of the page that the virtual machine cannot carry out, and why."""


def commands() -> list[str]:
    """All commands of the page, without their comments."""
    found = []
    for language, block in _BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        if language not in ("", "sh"):
            continue
        for line in block.replace("\\\n", "").splitlines():
            command = re.sub(r"\s+# .*$", "", line).strip()
            if command and not command.startswith("#"):
                found.append(" ".join(command.split()))
    return found
