"""Effects from outside: what a broken or greedy plugin package costs, and whom."""

from __future__ import annotations

import sys

import pytest

from abbe.compcore.effects import registry
from abbe.compcore.errors import InputError

GOOD = """
from abbe.compcore.effects import Drift

class Thing(Drift):
    kind = "creep"
"""


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    """Install a module under entry points of this environment, as pip would have left it."""

    def install(code: str, names: tuple[str, ...] = ("thing",)) -> None:
        (tmp_path / "strange_effect.py").write_text(code + "\n")
        info = tmp_path / "strange_effect-1.0.dist-info"
        info.mkdir()
        head = "Metadata-Version: 2.1\nName: strange-effect\nVersion: 1.0\n"
        (info / "METADATA").write_text(head)
        lines = [f"{name} = strange_effect:Thing" for name in names]
        (info / "entry_points.txt").write_text("\n".join(["[abbe.effects]", *lines, ""]))
        monkeypatch.syspath_prepend(str(tmp_path))
        registry.PLUGINS.forget()

    yield install
    sys.modules.pop("strange_effect", None)
    monkeypatch.undo()
    registry.PLUGINS.forget()


def test_a_plugin_s_effect_is_one_like_the_others(plugin):
    plugin(GOOD)
    assert list(registry.effect_kinds())[-1] == "creep"
    effect = registry.make_effect("creep", {"direction": "X"})
    assert effect.spec == "creep direction=X"
    assert registry.chapter(type(effect)) == "From plugin packages"


def test_without_it_the_kind_is_unknown():
    with pytest.raises(InputError, match=r"unknown kind of effect: found 'creep', expected one of"):
        registry.make_effect("creep", {"direction": "X"})


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import nowhere_at_all", "cannot be loaded (ModuleNotFoundError: No module"),
        ("raise RuntimeError('no licence')", "cannot be loaded (RuntimeError: no licence)"),
        ("", "cannot be loaded (AttributeError"),
        ("Thing = 3", "is not a kind of effect"),
        ("class Thing: kind = 'creep'", "is not a kind of effect"),
        ("import sys; sys.exit('no licence')", "cannot be loaded (SystemExit: no licence)"),
        ("raise ValueError('two\\nlines')", "cannot be loaded (ValueError: two lines)"),
        (GOOD.replace('"creep"', "3"), "does not say what it is called"),
        (GOOD.replace("creep", "backlash"), "claims Abbe's own name 'backlash'"),
    ],
)
def test_a_broken_plugin_is_named_and_spares_all_other_effects(plugin, code, said, caplog):
    plugin(code)
    assert registry.make_effect("backlash", {"axis": "X"}).spec == "backlash axis=X"
    assert not caplog.records, "nobody asked for a plugin"
    assert set(registry.effect_kinds()) == set(registry._BUILT_IN)
    (message,) = caplog.messages
    assert said in message
    assert "\n" not in message
    assert "left out" in message
    with pytest.raises(InputError) as caught:
        registry.make_effect("thing", {})
    assert said in str(caught.value)
    assert "strange_effect:Thing" in str(caught.value)
    with pytest.raises(InputError, match=r"unknown kind of effect: .*left out: thing"):
        registry.make_effect("creep", {"direction": "X"})


def test_two_plugins_cannot_claim_one_kind(plugin):
    plugin(GOOD, names=("thing", "other"))
    assert "creep" in registry.effect_kinds(), "the first has it"
    assert list(registry.PLUGINS.plugins().left_out) == ["other"]


def test_two_built_in_effects_cannot_either():
    with pytest.raises(ValueError, match="'backlash' is registered twice"):
        registry.register(registry.effect_class("backlash"))
