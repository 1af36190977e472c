"""Writing campaign files: what is read back is what was written."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from test_campaign_read import same

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup, Tool
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign, read_campaigns, write_campaign
from abbe.compcore.machine.conditions import Conditions
from tests.support.compcore.campaign_texts import CMM, GOOD, MILL, read_text

NAMES = (
    st.text(
        st.characters(codec="utf-8", exclude_categories=("Cc", "Cs", "Zl", "Zp")),
        min_size=1,
        max_size=8,
    )
    .map(str.strip)
    .filter(bool)
)
COORDINATE = st.floats(-5e3, 5e3)
VECTOR = st.tuples(COORDINATE, COORDINATE, COORDINATE)


@st.composite
def campaigns(draw):
    """Any campaign of the five-axis mill that the format can hold."""
    n = draw(st.integers(1, 6))

    def column(least=-1e6, greatest=1e6):
        return draw(arrays(np.float64, n, elements=st.floats(least, greatest)))

    def chosen(names):
        return np.array(draw(st.lists(st.sampled_from(names), min_size=n, max_size=n)), dtype=str)

    bases = draw(st.dictionaries(NAMES, VECTOR, min_size=2, max_size=3))
    offsets = draw(st.dictionaries(NAMES, VECTOR, max_size=2))
    free = st.lists(st.sampled_from("xyz"), unique=True).map(tuple)
    tools = {name: Tool(name, offset, draw(free)) for name, offset in offsets.items()}
    kind = np.array(draw(st.lists(st.sampled_from(list(Kind)), min_size=n, max_size=n)), np.int8)
    setup = chosen(draw(st.lists(NAMES, min_size=1, max_size=3)))
    words = st.lists(st.sampled_from(["zero", "slope", "frame"]), unique=True).map(tuple)
    base, base2 = np.zeros(n, dtype="U8"), np.zeros(n, dtype="U8")
    base[kind >= Kind.DISTANCE] = next(iter(bases))
    base2[kind == Kind.BASE_DISTANCE] = list(bases)[1]
    tool_name = chosen(["", *tools])
    tool = np.stack([column(-500, 500) for _ in range(3)], axis=1)
    for name in tools:
        tool[tool_name == name] = tools[name].offset
    u = draw(arrays(np.float64, (n, 3), elements=st.floats(-1, 1)).filter(
        lambda v: (np.linalg.norm(v, axis=1) > 0.1).all()
    ))  # fmt: skip
    u /= np.linalg.norm(u, axis=1)[:, None]
    u[kind >= Kind.DISTANCE] = 0.0
    distance = kind >= Kind.DISTANCE
    sd = column(1e-6, 0.1)
    sd[draw(arrays(np.bool_, n))] = np.nan
    signals = draw(st.lists(NAMES.map("s_".__add__), max_size=2, unique=True))
    turning = draw(st.booleans())
    notes = draw(st.text(max_size=9) | st.just("a\u2028b\x85c"))
    conditions = Conditions(
        positions={a: column(-4, 4) if a == "B" else column(-200, 200) for a in "XYZB"},
        directions={
            a: draw(arrays(np.float64, n, elements=st.sampled_from([-1.0, 0.0, 1.0])))
            for a in draw(st.sets(st.sampled_from("XYZB")))
        },
        tool=tool,
        time=column(),
        signals={s: column(-1e15, 1e15) for s in signals},
        spindle_angle=column(-7, 7) if turning else None,
        run=np.zeros(n, dtype=np.int64),
        setup=setup,
        u=u,
        base=base,
    )
    return Campaign(
        name="any",
        conditions=conditions,
        kind=kind,
        value=np.where(distance, column(1e-3, 1e4), column(-0.1, 0.1)),
        sd=sd,
        base2=base2,
        tool_name=tool_name,
        line=np.arange(n),
        setups={str(s): Setup(str(s), draw(words)) for s in dict.fromkeys(setup.tolist())},
        bases=bases,
        tools=tools,
        metadata=({"format": "abbe-campaign/1", "notes": notes},),
        spindle="C" if turning else None,
    )


@settings(
    max_examples=150,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(campaigns())
def test_any_campaign_reads_back_equal(tmp_path, campaign):
    path = tmp_path / "out.csv"
    write_campaign(campaign, path)
    back = read_campaign(path, MILL)
    alike(back, campaign)
    write_campaign(back, path)
    same(read_campaign(path, MILL), back)  # what was read is kept to the last bit


def alike(a: Campaign, b: Campaign) -> None:
    """Equal up to the last place of a binary fraction."""
    close = {"rtol": 4.5e-16, "atol": 5e-324}
    np.testing.assert_array_equal(a.kind, b.kind)
    np.testing.assert_array_equal(a.base2, b.base2)
    np.testing.assert_array_equal(a.tool_name, b.tool_name)
    np.testing.assert_allclose(a.value, b.value, **close)
    np.testing.assert_allclose(a.sd, b.sd, **close)
    for name in ("time", "tool", "setup", "base"):
        np.testing.assert_array_equal(
            getattr(a.conditions, name), getattr(b.conditions, name), err_msg=name
        )
    np.testing.assert_allclose(a.conditions.u, b.conditions.u, atol=3e-16)
    if b.conditions.spindle_angle is not None:
        np.testing.assert_allclose(a.conditions.spindle_angle, b.conditions.spindle_angle, **close)
    for name in ("positions", "directions", "signals"):
        left, right = getattr(a.conditions, name), getattr(b.conditions, name)
        assert set(left) == set(right)
        for key in left:
            np.testing.assert_allclose(left[key], right[key], **close)
    assert dict(a.setups) == dict(b.setups)
    assert (dict(a.bases), dict(a.tools)) == (dict(b.bases), dict(b.tools))
    assert a.spindle == b.spindle
    assert [dict(m) for m in a.metadata] == [dict(m) for m in b.metadata]


def test_a_file_that_was_read_is_written_with_its_own_decimals(tmp_path):
    write_campaign(read_text(tmp_path, GOOD), tmp_path / "out.csv")
    text = (tmp_path / "out.csv").read_text()
    assert ",412.345678,0.0006,20.12,20.3" in text
    assert ",-2.5,,20.12" in text
    same(read_campaign(tmp_path / "out.csv", CMM), read_text(tmp_path, GOOD))


def test_joined_campaigns_do_not_fit_into_one_file(tmp_path):
    (tmp_path / "a.csv").write_text(GOOD)
    (tmp_path / "b.csv").write_text(GOOD.replace("1.25", "1.75"))
    joined = read_campaigns([tmp_path / "a.csv", tmp_path / "b.csv"], CMM)
    with pytest.raises(InputError, match="clocks"):
        write_campaign(joined, tmp_path / "c.csv")
    assert not (tmp_path / "c.csv").exists()


@pytest.mark.parametrize("where", ["value", "time", "T_x"])
def test_what_is_no_number_is_not_written_and_nothing_is_overwritten(tmp_path, where):
    campaign = read_text(tmp_path, GOOD)
    array = {
        "value": campaign.value,
        "time": campaign.conditions.time,
        "T_x": campaign.conditions.signals["T_x"],
    }[where]
    array[-1] = np.nan
    (tmp_path / "out.csv").write_text("precious")
    with pytest.raises(InputError) as caught:
        write_campaign(campaign, tmp_path / "out.csv")
    assert caught.value.field == where
    assert (tmp_path / "out.csv").read_text() == "precious"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["campaign.csv", "out.csv"]


@pytest.mark.parametrize("name", ["", " x", "a\nb"])
def test_names_that_the_format_cannot_hold(tmp_path, name):
    campaign = read_text(tmp_path, GOOD)
    campaign.conditions.setup[0] = name
    with pytest.raises(InputError, match="not a name"):
        write_campaign(campaign, tmp_path / "out.csv")
