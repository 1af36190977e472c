"""Dialects are found by looking; every one says what it holds and how sure Abbe is of it."""

from __future__ import annotations

import re
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

import abbe.drivers.controllers as registry
from abbe.compcore import plugins
from abbe.compcore.errors import InputError
from abbe.compcore.tables.compensation_types import TYPES
from abbe.drivers.controllers import (
    Confidence,
    controller_class,
    controller_kinds,
    make_controller,
)
from tests.support.drivers.controllers.cases import machine

ROOT = Path(__file__).parents[3]
FIRST = {
    "linuxcnc", "twincat-isg", "etalon-exchange", "siemens-840d", "fanuc", "heidenhain-nd",
    "heidenhain-tnc", "pmac",
    "aerotech-2d", "weihong", "cmm-map", "csv", "grid-csv",
}  # fmt: skip


CANNOT = ("Siemens VCS", "Fanuc straightness", "Fanuc three-dimensional", "TNC 407", "Zeiss CAA")
"""What a user may look for and not find."""


def test_these_are_there():
    assert set(controller_kinds()) == FIRST


@pytest.mark.parametrize("name", sorted(FIRST))
def test_every_dialect_tells_all_of_itself(name):
    cls = controller_class(name)
    controller = make_controller(name, machine("w C' b X Y Z t"))
    assert cls.__doc__
    assert cls.title
    assert cls.source
    assert len(controller.activation()) >= 1
    capability = controller.capability
    assert capability.holds
    for holds in capability.holds:
        assert set(holds.types) <= set(TYPES), "types of ISO/TR 16907, 8.2"
        assert holds.points >= 2
        assert holds.resolution > 0.0
    if cls.trust.least is Confidence.UNVERIFIED:
        assert cls.trust.note, "what is not sure is said"
    trust = cls.trust.as_dict()
    assert {"syntax", "sign", "activation"} <= set(trust)
    for field_name in cls.Options.model_fields:
        assert re.fullmatch(r"[a-z_]+", field_name)


@pytest.mark.parametrize("name", sorted(FIRST))
def test_the_users_page_names_every_dialect_and_option(name):
    page = (ROOT / "docs" / "tables.md").read_text(encoding="utf-8")
    assert f"`{name}`" in page
    for option in controller_class(name).Options.model_fields:
        assert f"`{option}`" in page, option


def test_an_unknown_name_or_option_lists_those_there_are():
    with pytest.raises(InputError, match="linuxcnc"):
        controller_class("mazatrol")
    with pytest.raises(InputError, match="no such option") as raised:
        make_controller("linuxcnc", machine(), {"typ": "1"})
    assert "type" in str(raised.value)
    with pytest.raises(InputError, match="type"):
        make_controller("linuxcnc", machine(), {"type": "2"})
    with pytest.raises(InputError, match="axes"):
        make_controller("fanuc", machine(), {"axes": "X1"})


PLUGIN = '''
from abbe.drivers.controllers import Confidence, Controller, Trust
from abbe.compcore.tables.capability import Capability, Holds

class Mine(Controller):
    """One number a line."""
    name = "mine"
    title = "My own control"
    sign = "error"
    source = "me"
    trust = Trust(Confidence.TRIED, Confidence.TRIED, Confidence.TRIED)

    @property
    def capability(self):
        return Capability((Holds("axis", ("L-POS",), points=16, resolution=1e-3),))

    def _format(self, tables):
        return {t.inputs[0]: "\\n".join(f"{q:.6f} {v:.3f}" for q, v in
                zip(t.nodes[0], t.forward)) for t in tables}

    def _parse(self, files):
        import numpy as np
        from abbe.compcore.tables import Table, move
        rows = {a: np.array([l.split() for l in text.splitlines()], float)
                for a, text in files.items()}
        return [Table(move(a), (a,), (r[:, 0],), r[:, 1]) for a, r in rows.items()]

    def activation(self):
        return ("switch it on",)
'''


@pytest.fixture
def plugged(tmp_path, monkeypatch):
    (tmp_path / "my_control.py").write_text(PLUGIN, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)

    def plug(value: str, name: str = "mine") -> None:
        entry = EntryPoint(name, value, registry.CONTROLLER_GROUP)
        monkeypatch.setattr(plugins, "entry_points", lambda group: [entry])
        registry.PLUGINS.forget()

    yield plug
    monkeypatch.undo()
    registry.PLUGINS.forget()
    sys.modules.pop("my_control", None)


def test_a_plugin_is_one_file_and_serves_like_any_other(plugged, tmp_path):
    import numpy as np

    from abbe.compcore.tables.field import ErrorField
    from abbe.compcore.tables.projection.project import project
    from abbe.compcore.tables.volume import Volume
    from tests.support.compcore.table_models import rigid, state

    plugged("my_control:Mine")
    assert set(controller_kinds()) == FIRST | {"mine"}
    model = rigid()
    controller = make_controller("mine", model.machine)
    field = ErrorField(model, state())
    tables = project(field, Volume.of(model.machine), controller.capability).tables
    files = controller.write(tables)
    assert set(files) == {"X", "Y", "Z"}
    assert all(len(t.nodes[0]) <= 16 for t in tables)
    assert np.abs(controller.read(files)[0].forward).max() > 0.0


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("my_control:Trust", "not a controller"),
        ("abbe.drivers.controllers.linuxcnc:LinuxCNC", "claims Abbe's own name 'linuxcnc'"),
        ("nowhere_at_all:Mine", "ModuleNotFoundError"),
        ("strange_control:Mine", "SystemExit: no licence"),
    ],
)
def test_a_broken_plugin_is_left_out_and_costs_nobody_else(plugged, tmp_path, caplog, value, said):
    (tmp_path / "strange_control.py").write_text("import sys\nsys.exit('no licence')\n")
    plugged(value, "strange")
    assert registry.controller_class("linuxcnc").name == "linuxcnc"
    assert not caplog.records, "nobody asked for a plugin"
    assert set(controller_kinds()) == FIRST
    (message,) = caplog.messages
    assert said in message
    with pytest.raises(InputError, match="plugin") as caught:
        registry.controller_class("strange")
    assert said in str(caught.value)


def test_what_is_not_possible_is_said_with_the_reason():
    reasons = {c.what: c.why for cls in controller_kinds().values() for c in cls.cannot}
    for name in CANNOT:
        (why,) = [why for what, why in reasons.items() if name in what]
        assert len(why.split()) > 5, name
