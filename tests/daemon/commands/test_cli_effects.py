"""``abbe effects`` as a user runs it."""

import json
import sys

import pytest

from abbe.compcore.effects import effect_class, effect_kinds
from abbe.compcore.effects.handbook import KEY_WORDS, SECTIONS, effect_page
from abbe.daemon.cli import main


@pytest.fixture
def abbe(monkeypatch, capsys):
    """Run a command; exit status, standard output, standard error."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["abbe", *map(str, arguments)])
        monkeypatch.setenv("COLUMNS", "100")
        with pytest.raises(SystemExit) as caught:
            main()
        out, err = capsys.readouterr()
        return int(caught.value.code or 0), out, err

    return run


def test_the_list_has_every_kind_in_its_chapter(abbe):
    status, out, err = abbe("effects")
    assert (status, err) == (0, "")
    lines = [line.split() for line in out.splitlines()]
    listed = [words[0] for words in lines if words and words[0] in effect_kinds()]
    assert listed == list(effect_kinds())
    assert out.index("Geometry of linear axes") < out.index("backlash") < out.index("Thermal")
    assert "instrument" in out
    assert "workpiece" in out


def test_the_list_as_json(abbe):
    status, out, _ = abbe("effects", "--json")
    listed = json.loads(out)["effects"]
    assert status == 0
    assert [e["kind"] for e in listed] == list(effect_kinds())
    tilt = next(e for e in listed if e["kind"] == "thermal_tilt")
    assert tilt["scope"] == "machine"
    assert [k["name"] for k in tilt["keys"] if k["required"]] == ["axis", "about"]
    assert {e["scope"] for e in listed} == {"machine", "workpiece", "instrument"}


@pytest.mark.parametrize("kind", effect_kinds())
def test_a_page_has_all_that_a_handbook_s_page_has(abbe, kind):
    status, out, err = abbe("effects", kind)
    assert (status, err) == (0, "")
    at = [out.index(f"\n{title}\n") for title in (*SECTIONS, "Keys")]
    assert at == sorted(at)
    assert "`" not in out
    flat = " ".join(out.split())
    for key in effect_class(kind).model_fields:
        assert f" {key} " in flat
    assert f"abbe add MODEL {kind}" in flat


def test_a_page_as_json(abbe):
    status, out, _ = abbe("effects", "cyclic", "--json")
    page = json.loads(out)
    assert status == 0
    assert tuple(page["sections"]) == SECTIONS
    assert page["usage"] == "cyclic axis=… [harmonics=1] [period=…] [number=…]"
    assert page["keys"][1] == {
        "name": "harmonics",
        "required": False,
        "default": "1",
        "description": "number of harmonics",
    }


def test_an_unknown_kind_lists_those_that_exist(abbe):
    status, out, err = abbe("effects", "wobble")
    assert (status, out) == (1, "")
    assert "unknown kind of effect: found 'wobble', expected one of positioning, scale" in err
    assert "Traceback" not in err


@pytest.mark.parametrize("kind", effect_kinds())
def test_every_key_is_explained(kind):
    page = effect_page(effect_class(kind))
    assert [k.name for k in page.keys if not k.words] == []
    assert page.summary.endswith((".", ")"))


def test_no_words_are_left_over():
    used = {name for cls in effect_kinds().values() for name in cls.model_fields}
    assert used == set(KEY_WORDS)
