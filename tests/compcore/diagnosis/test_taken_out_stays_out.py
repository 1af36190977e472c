"""What ``diagnose --apply`` took out again as superfluous does not come back beside the same."""

from __future__ import annotations

from pathlib import Path

from abbe.compcore.diagnosis.stepwise.growing_model import GrowingModel
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model

BRIDGE = Path(__file__).parents[2] / "data" / "p03-bridge"
ANYHOW = 2.0
"""Part to which left-out χ² may fall: it may rise to twice of it."""


def test_it_comes_back_beside_other_effects_only() -> None:
    """A motion worth a hundredth was added and taken out, two dozen times on end."""
    model = load_model(BRIDGE / "model.toml")
    steps: list[str] = []
    growing = GrowingModel(
        model,
        read_campaign(BRIDGE / "fit.csv", model.machine),
        lambda step: steps.append(step.action),
        lambda _: None,
    )
    nothing = make_effect("drift", {"direction": "Y"})
    assert growing.add(nothing, falls=ANYHOW)
    assert growing.prune()
    assert not growing.add(nothing, falls=ANYHOW)
    assert steps == ["began", "added", "removed"]
    # beside a cause that the machine has it is asked anew
    assert growing.add(make_effect("backlash", {"axis": "Z"}))
    assert growing.add(nothing, falls=ANYHOW)
