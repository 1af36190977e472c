"""A held-out campaign refuses what predicts it worse: a thermometer that only went along."""

from __future__ import annotations

from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.stepwise import Course, UnseenCampaign, to_the_verdict
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from benchmarks.hidden.judging.trial import as_campaign
from tests.support.compcore.lathe_days import LATHE, lathe_days


def specs(course: Course) -> list[str]:
    return [e.spec for e in course.last.result.model.effects]


def test_what_predicts_the_held_out_campaign_worse_is_refused() -> None:
    model = parse_model(TomlSource(LATHE))
    fitted, other = (
        as_campaign(lathe_days(1, alone=False), model),
        as_campaign(lathe_days(2, alone=True), model),
    )
    alone = to_the_verdict(model, fitted)
    assert any("cabinet" in spec for spec in specs(alone))
    assert not alone.spoiling
    course = to_the_verdict(model, fitted, unseen=UnseenCampaign(other, compare))
    assert not any("cabinet" in spec for spec in specs(course))
    assert any("cabinet" in e.spec for effects in course.spoiling for e in effects)
    assert not {e for s in course.spoiling for e in s} & set(course.refused)


def test_what_the_held_out_campaign_agrees_with_is_the_same_model() -> None:
    model = parse_model(TomlSource(LATHE))
    fitted, other = (
        as_campaign(lathe_days(1, alone=False), model),
        as_campaign(lathe_days(2, alone=False), model),
    )
    assert specs(to_the_verdict(model, fitted, unseen=UnseenCampaign(other, compare))) == specs(
        to_the_verdict(model, fitted)
    )
