"""Alert rules: promtool finds them sound, each fires for what it is there for and nothing else."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.support.daemon.plant_files import ALERTS, PLANT, dashboard, named, questions
from tests.support.daemon.prometheus_tools import PrometheusTools

SOUND: dict[str, str] = {
    'up{job="abbe", instance="m"}': "1x120",
    "abbe_cycle_alive": "1x120",
    "abbe_corrected_in_full": "1x120",
    "abbe_computed_in_full": "1x120",
    "abbe_writes": "1x120",
    'abbe_axis_stale{axis="X"}': "0x120",
    'abbe_signal_stale{signal="T_x1"}': "0x120",
    'abbe_link_state{link="cmm", abbe_link_state="up"}': "1x120",
    'abbe_link_state{link="cmm", abbe_link_state="down"}': "0x120",
    'abbe_link_reconnects_total{link="cmm"}': "3x120",
    'abbe_link_requests_total{link="cmm"}': "0+3000x120",
    'abbe_link_failures_total{link="cmm"}': "0+10x120",
    "abbe_cycles_total": "0+3000x120",
    "abbe_cycles_missed_total": "0+5x120",
    'abbe_check_verdict{abbe_check_verdict="sound"}': "1x120",
    'abbe_check_verdict{abbe_check_verdict="changed"}': "0x120",
    "abbe_check_last_time_seconds": "0x120",
    'abbe_file_differs{role="model", path="m.toml"}': "0x120",
    'abbe_events_total{level="error"}': "2x120",
    'abbe_events_total{level="warning"}': "0+1x120",
}
"""Two hours of a machine of which nothing is to be said, a sample a minute."""

BAD: dict[str, tuple[dict[str, str], str]] = {
    "AbbeGone": ({'up{job="abbe", instance="m"}': "1x60 0x60"}, "64m"),
    "AbbeCycleHangs": ({"abbe_cycle_alive": "1x60 0x60"}, "63m"),
    "AbbeNotCorrected": ({"abbe_corrected_in_full": "1x60 0x60"}, "63m"),
    "AbbeNotComputed": (
        {"abbe_writes": "0x120", "abbe_corrected_in_full": "0x120",
         "abbe_computed_in_full": "1x60 0x60"},
        "63m",
    ),
    "AbbeAxisStale": ({'abbe_axis_stale{axis="X"}': "0x60 1x60"}, "63m"),
    "AbbeSignalStale": ({'abbe_signal_stale{signal="T_x1"}': "0x60 1x60"}, "64m"),
    "AbbeLinkDown": ({'abbe_link_state{link="cmm", abbe_link_state="down"}': "0x60 1x60"}, "63m"),
    "AbbeLinkUnsteady": ({'abbe_link_reconnects_total{link="cmm"}': "0x60 0+1x60"}, "80m"),
    "AbbeLinkFails": ({'abbe_link_failures_total{link="cmm"}': "0+100x120"}, "63m"),
    "AbbeCyclesMissed": ({"abbe_cycles_missed_total": "0+100x120"}, "63m"),
    "AbbeMachineChanged": (
        {'abbe_check_verdict{abbe_check_verdict="changed"}': "0x60 1x60"}, "61m",
    ),
    "AbbeCheckRefused": ({'abbe_check_refused{point="ball"}': "_x30 1x90"}, "95m"),
    "AbbeNotChecked": ({"abbe_check_last_time_seconds": f"{-31 * 86400}x120"}, "63m"),
    "AbbeOutsideMeasured": ({'abbe_outside_measured{what="X"}': "_x30 1x90"}, "95m"),
    "AbbeFileDiffers": ({'abbe_file_differs{role="model", path="m.toml"}': "0x30 1x90"}, "95m"),
    "AbbeErrors": ({'abbe_events_total{level="error"}': "2x60 3x60"}, "63m"),
}  # fmt: skip
"""Alert → what is other than sound, and when it has fired."""
FIRING = 'count by (alertname) (ALERTS{alertstate="firing"})'


def _case(series: dict[str, str], at: str, fired: list[str]) -> dict[str, Any]:
    samples = [{"labels": f'{{alertname="{name}"}}', "value": 1} for name in fired]
    return {
        "interval": "1m",
        "input_series": [{"series": s, "values": v} for s, v in {**SOUND, **series}.items()],
        "promql_expr_test": [{"expr": FIRING, "eval_time": at, "exp_samples": samples}],
    }


def _promtool(*arguments: str | Path) -> str:
    command = [PrometheusTools.found().promtool, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.integration
def test_each_alert_fires_for_what_it_is_there_for_and_for_nothing_else(tmp_path: Path) -> None:
    said = _promtool("check", "rules", ALERTS)
    assert f"SUCCESS: {len(BAD)} rules found" in said
    cases = [_case({}, "119m", [])]
    cases += [_case(series, at, [name]) for name, (series, at) in BAD.items()]
    # before it lasts for long enough nothing fires
    cases += [_case(BAD["AbbeGone"][0], "61m", []), _case(BAD["AbbeOutsideMeasured"][0], "60m", [])]
    test = {"rule_files": [str(ALERTS)], "evaluation_interval": "1m", "tests": cases}
    (tmp_path / "test.yml").write_text(json.dumps(test), "utf-8")  # JSON is YAML
    _promtool("test", "rules", tmp_path / "test.yml")


def test_the_page_tells_every_alert() -> None:
    page = (PLANT.parents[1] / "docs" / "plant.md").read_text("utf-8")
    assert [name for name in BAD if f"`{name}`" not in page] == []


def test_the_dashboard_is_one() -> None:
    found = dashboard()
    panels = found["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels) > 12
    taken = set()
    for panel in panels:
        at = panel["gridPos"]
        assert at["x"] + at["w"] <= 24
        cells = {(x, y) for x in range(at["x"], at["x"] + at["w"])
                 for y in range(at["y"], at["y"] + at["h"])}  # fmt: skip
        assert not taken & cells, panel["title"]
        taken |= cells
        assert panel["datasource"]["uid"] == "${datasource}"
    assert {v["name"] for v in found["templating"]["list"]} == {"datasource", "machine"}
    assert all('instance=~".*"' in question for _, question in questions())
    assert len(named()) > 20
