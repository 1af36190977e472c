"""The files for a plant's Prometheus and Grafana, and the metrics that they name."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

PLANT = Path(__file__).parents[3] / "examples" / "plant"
ALERTS = PLANT / "abbe-alerts.yml"
DASHBOARD = PLANT / "abbe-dashboard.json"


def dashboard() -> dict[str, Any]:
    """Grafana's dashboard."""
    found: dict[str, Any] = json.loads(DASHBOARD.read_text("utf-8"))
    return found


def questions() -> Iterator[tuple[str, str]]:
    """Panel and what it asks Prometheus, for all machines."""
    for panel in dashboard()["panels"]:
        for target in panel["targets"]:
            yield panel["title"], target["expr"].replace("$machine", ".*")


def named() -> set[str]:
    """Metrics that the rules and the dashboard name, as samples are called."""
    texts = [line for line in ALERTS.read_text("utf-8").splitlines() if "expr:" in line]
    texts += [question for _, question in questions()]
    return set(re.findall(r"\babbe_\w+(?=[\s{\[]|$)", " ".join(texts)))


def scraped(text: str) -> set[str]:
    """Metrics of a scrape, as samples are called, and those that could have samples there."""
    found = set(re.findall(r"^(abbe_\w+)[ {]", text, re.MULTILINE))
    return found | set(re.findall(r"^# TYPE (abbe_\w+) ", text, re.MULTILINE))
