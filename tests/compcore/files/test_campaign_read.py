"""Reading campaign files: every cell where it belongs, in the units inside the code."""

import hashlib
import tracemalloc

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup, Tool
from abbe.compcore.effects import ScaleExpansion
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv import lines as lines_module
from abbe.compcore.files.campaign_file import (
    bare_machine,
    read_campaign,
    read_campaigns,
    require_signals,
)
from abbe.compcore.files.model_file import load_model
from abbe.compcore.model.model import Model
from tests.support.compcore.campaign_texts import CMM, DATA, GOOD, MILL, good_lines, read_text


def test_every_kind_of_row_in_the_units_inside_the_code(tmp_path):
    c = read_text(tmp_path, GOOD)
    assert c.n == 5
    assert c.kind.tolist() == [0, 0, 1, 2, 3]
    np.testing.assert_allclose(c.value, [0.0, 1.25e-3, -2.5e-6, 412.345678, 590.001], rtol=1e-15)
    np.testing.assert_allclose(c.sd, [0.5e-3, 0.5e-3, np.nan, 6e-4, 6e-4], rtol=1e-15)
    q = c.conditions
    assert q.position("X").tolist()[:4] == [0.0, 100.0, 100.0, 100.0]
    assert q.direction("X").tolist() == [1.0, 1.0, -1.0, 0.0, 0.0]
    assert q.tool.tolist()[:4] == [[0.0, 0.0, -150.0]] * 4
    assert c.tool_name.tolist() == ["", "", "T1", "T1", ""]
    assert q.u is not None
    assert q.u.tolist()[:4] == [[1, 0, 0], [1, 0, 0], [0, 0.6, -0.8], [0, 0, 0]]
    assert q.time.tolist() == [0.0, 1.5, 3.0, 9.0, 9.9]
    assert q.signal("T_amb").tolist() == [20.3] * 5
    assert q.base is not None
    assert q.base.tolist() == ["", "", "", "B1", "B1"]
    assert c.base2.tolist() == ["", "", "", "", "B2"]
    assert q.run is not None
    assert q.run.tolist() == [0] * 5
    assert c.line.tolist() == [17, 18, 19, 20, 21]
    assert c.bases == {"B1": (10.0, 20.0, -400.0), "B2": (600.0, 20.0, -400.0)}
    assert c.tools == {"T1": Tool("T1", (0.0, 0.0, -150.0), ("x", "z"))}
    assert dict(c.metadata[0]) == {
        "format": "abbe-campaign/1",
        "machine": "Bridge CMM",
        "instrument": "laser interferometer",
        "notes": "warm-up 2 h; load none; feed 1500 mm/min",
    }
    assert c.files == {str(tmp_path / "campaign.csv"): hashlib.sha256(GOOD.encode()).hexdigest()}


def test_setups_that_are_not_listed_get_the_format_s_defaults(tmp_path):
    text = GOOD.replace('# [setups.x_pos_1]\n# free = ["zero"]\n', "")
    c = read_text(tmp_path, text)
    assert c.setups == {
        "x_pos_1": Setup("x_pos_1", ("zero",)),
        "x_straight_y": Setup("x_straight_y", ("zero", "slope")),
        "ball bar": Setup("ball bar", ()),
        "bases": Setup("bases", ()),
    }


def test_listed_setups_without_rows_are_left_out(tmp_path):
    c = read_text(tmp_path, GOOD.replace("# [bases.B1]", "# [setups.x]\n# free = []\n# [bases.B1]"))
    assert "x" not in c.setups


def test_a_distance_between_bases_needs_no_position(tmp_path):
    c = read_text(tmp_path, GOOD)
    q = c.conditions
    assert [q.position(a)[4] for a in "XYZ"] == [
        350.0,
        450.0,
        -180.0,
    ]  # the middle: nothing is read
    assert q.signal("T_x")[4] == 20.12  # carried on, so that a lagged temperature sees no step
    assert c.coverage().moving == {"X"}


def test_rotary_axes_and_the_spindle_turn_in_degrees(tmp_path):
    text = (
        '# format = "abbe-campaign/1"\n'
        "time,setup,kind,X,Y,Z,B,C,ux,uy,uz,value\n"
        "0,s,displacement,0,0,0,90,-30,1,0,0,1\n"
    )
    c = read_text(tmp_path, text, MILL)
    np.testing.assert_allclose(c.conditions.position("B"), [np.pi / 2], rtol=1e-15)
    assert c.conditions.spindle_angle is not None
    np.testing.assert_allclose(c.conditions.spindle_angle, [-np.pi / 6], rtol=1e-15)
    assert c.spindle == "C"
    bracketed = read_text(tmp_path, text.replace(",C,", ",(C),"), MILL)
    assert bracketed.conditions.spindle_angle is not None


def test_optional_columns_may_be_absent(tmp_path):
    c = read_text(
        tmp_path,
        '# format = "abbe-campaign/1"\n'
        "time,setup,kind,X,Y,Z,ux,uy,uz,value\n"
        "0,s,displacement,1,2,3,0,0,1,1\n",
    )
    assert c.conditions.directions == {}
    assert c.conditions.direction("X").tolist() == [0.0]
    assert c.conditions.tool.tolist() == [[0.0, 0.0, 0.0]]
    assert np.isnan(c.sd).all()
    assert c.conditions.spindle_angle is None
    assert c.conditions.signals == {}


def test_distances_alone_need_no_unit_vectors(tmp_path):
    c = read_text(
        tmp_path,
        '# format = "abbe-campaign/1"\n# [bases.B1]\n# position = [0, 0, -500]\n'
        "time,setup,kind,X,Y,Z,base,value\n"
        "0,s,distance,1,2,3,B1,500\n",
    )
    assert c.kind.tolist() == [Kind.DISTANCE]


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda b: b"\xef\xbb\xbf" + b, id="byte order mark"),
        pytest.param(lambda b: b.replace(b"\n", b"\r\n"), id="CRLF"),
        pytest.param(lambda b: b.rstrip(b"\n"), id="no last line end"),
        pytest.param(lambda b: b + b"\n \n\n", id="blank lines at the end"),
        pytest.param(lambda b: b.replace(b"ball bar", b'"ball bar"'), id="quoted name"),
        pytest.param(lambda b: b.replace(b",412.345678", b',"412.345678"'), id="quoted number"),
        pytest.param(lambda b: b.replace(b"100,450", b" 100 ,+450."), id="spaces, sign, point"),
        pytest.param(
            lambda b: b.replace(b"time,setup", b"time , setup"), id="spaces in the header"
        ),
    ],
)
def test_what_editors_and_spreadsheets_do_to_a_file_changes_nothing(tmp_path, change):
    same(read_text(tmp_path, change(GOOD.encode())), read_text(tmp_path, GOOD))


def test_a_file_saved_by_a_spreadsheet(tmp_path):
    """Metadata lines quoted and padded with empty cells to the table's width."""
    out = []
    for line in good_lines():
        if line.startswith("#"):
            text = '"' + line.replace('"', '""') + '"' if '"' in line or "," in line else line
            out.append(text + "," * 21)
        else:
            out.append(line)
    same(read_text(tmp_path, "\r\n".join(out)), read_text(tmp_path, GOOD))


def test_three_decimals_are_enough_for_a_unit_vector(tmp_path):
    c = read_text(tmp_path, GOOD.replace("0,0.6,-0.8", "0.577,0.577,0.577"))
    assert c.conditions.u is not None
    np.testing.assert_allclose(c.conditions.u[2], [3**-0.5] * 3, rtol=1e-15)


def same(a: Campaign, b: Campaign) -> None:
    """Assert that two campaigns hold the same measurements."""
    for name in ("kind", "value", "sd", "base2", "tool_name"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    for name in ("time", "tool", "u", "setup", "base", "spindle_angle"):
        np.testing.assert_array_equal(
            getattr(a.conditions, name), getattr(b.conditions, name), err_msg=name
        )
    for name in ("positions", "directions", "signals"):
        left, right = getattr(a.conditions, name), getattr(b.conditions, name)
        assert list(left) == list(right)
        for key in left:
            np.testing.assert_array_equal(left[key], right[key], err_msg=f"{name} {key}")
    assert (a.setups, a.bases, a.tools) == (b.setups, b.bases, b.tools)
    assert [dict(m) for m in a.metadata] == [dict(m) for m in b.metadata]


@pytest.mark.parametrize("folder", ["p01-mill", "p02-bridge", "p03-bridge"])
def test_real_campaigns(folder):
    model = load_model(DATA / folder / "model.toml")
    c = read_campaign(DATA / folder / "fit.csv", model.machine)
    require_signals(c, model)
    assert c.n == 2117
    listed = (DATA / folder / "fit.csv").read_text().count("# [setups.")
    assert len(c.setups) == listed
    independent = np.genfromtxt(
        DATA / folder / "fit.csv", delimiter=",", skip_header=int(c.line[0]) - 1, usecols=(3, 15)
    )
    np.testing.assert_array_equal(c.conditions.position("X"), independent[:, 0])
    per_mm = np.where(c.kind == Kind.ROTATION, 1e6, 1e3)
    np.testing.assert_allclose(c.value * per_mm, independent[:, 1], rtol=1e-14)


def test_pieces_of_a_file_join_without_a_seam(tmp_path, monkeypatch):
    text = GOOD + "".join(
        f"{10 + i},x_pos_1,displacement,{i},450,-180,1,0,0,0,0,-150,1,0,0,0.1,0.5,20.1,20.3,,,\n"
        for i in range(300)
    )
    whole = read_text(tmp_path, text)
    for size in (1, 7, 64, 1000):
        monkeypatch.setattr(lines_module, "CHUNK", size)
        same(read_text(tmp_path, text), whole)


def test_memory_beside_the_result_does_not_grow_with_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(lines_module, "CHUNK", 1 << 14)
    extra = []
    for rows in (2_000, 20_000):
        text = GOOD + "".join(
            f"{10 + i},x_pos_1,displacement,1,450,-180,1,0,0,0,0,-150,1,0,0,0.1,0.5,20.1,2,,,\n"
            for i in range(rows)
        )
        path = tmp_path / f"{rows}.csv"
        path.write_text(text)
        del text
        tracemalloc.start()
        campaign = read_campaign(path, CMM)
        kept, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert campaign.n == rows + 5
        extra.append((peak - kept) / campaign.n)
    # bytes a row, beyond what is kept: two columns' worth of copies, not the file's text
    assert extra[1] < 150 < 8 * 22
    assert extra[1] < extra[0]


def test_several_campaigns_have_clocks_and_names_of_their_own(tmp_path):
    (tmp_path / "a.csv").write_text(GOOD)
    (tmp_path / "b.csv").write_text(GOOD.replace("1.25", "1.75").replace('"zero", "slope"', ""))
    c = read_campaigns([tmp_path / "a.csv", tmp_path / "b.csv"], CMM)
    assert c.n == 10
    assert c.conditions.run is not None
    assert c.conditions.run.tolist() == [0] * 5 + [1] * 5
    assert c.conditions.setup is not None
    assert c.conditions.setup[[0, 5]].tolist() == ["x_pos_1", "x_pos_1@b"]
    assert c.setups["x_straight_y"].free == ("zero", "slope")
    assert c.setups["x_straight_y@b"] == Setup("x_straight_y@b", ())
    assert c.conditions.base is not None
    assert c.conditions.base[[3, 8]].tolist() == ["B1", "B1@b"]
    assert c.base2[[4, 9]].tolist() == ["B2", "B2@b"]
    assert c.tool_name[[2, 7]].tolist() == ["T1", "T1@b"]
    assert set(c.tools) == {"T1", "T1@b"}
    assert c.tools["T1@b"].name == "T1@b"
    assert set(c.bases) == {"B1", "B2", "B1@b", "B2@b"}
    assert len(c.files) == 2
    assert len(c.metadata) == 2


def test_three_files_of_one_name_still_have_different_setups(tmp_path):
    paths = []
    for i in range(3):
        (tmp_path / str(i)).mkdir()
        paths.append(tmp_path / str(i) / "day.csv")
        paths[-1].write_text(GOOD.replace("1.25", f"1.{i}"))
    c = read_campaigns(paths, CMM)
    assert {"x_pos_1", "x_pos_1@day", "x_pos_1@day#2"} <= set(c.setups)


def test_one_campaign_alone_is_left_as_it_is(tmp_path):
    (tmp_path / "a.csv").write_text(GOOD)
    same(read_campaigns([tmp_path / "a.csv"], CMM), read_text(tmp_path, GOOD))


def test_the_same_measurements_twice_are_refused(tmp_path):
    (tmp_path / "a.csv").write_text(GOOD)
    (tmp_path / "b.csv").write_text(GOOD)
    with pytest.raises(InputError, match="same campaign twice") as caught:
        read_campaigns([tmp_path / "a.csv", tmp_path / "b.csv"], CMM)
    assert caught.value.file == str(tmp_path / "b.csv")


def test_a_signal_that_only_one_of_two_files_records(tmp_path):
    (tmp_path / "a.csv").write_text(GOOD)
    (tmp_path / "b.csv").write_text(GOOD.replace("T_x", "T_else"))
    c = read_campaigns([tmp_path / "a.csv", tmp_path / "b.csv"], CMM)
    assert set(c.conditions.signals) == {"T_amb"}
    assert c.lacking == {
        "T_x": (str(tmp_path / "b.csv"),),
        "T_else": (str(tmp_path / "a.csv"),),
    }
    with pytest.raises(InputError) as caught:
        require_signals(c, Model(CMM).with_effects(ScaleExpansion(axis="X", signals=("T_x",))))
    assert caught.value.file == str(tmp_path / "b.csv")


def test_a_signal_that_an_effect_needs(tmp_path):
    model = Model(CMM).with_effects(ScaleExpansion(axis="X", signals=("T_x",)))
    require_signals(read_text(tmp_path, GOOD), model)
    without = read_text(tmp_path, GOOD.replace(",T_x,", ",T_other,"))
    with pytest.raises(InputError) as caught:
        require_signals(without, model)
    assert caught.value.field == "T_x"
    assert caught.value.file == str(tmp_path / "campaign.csv")
    assert "scale_expansion axis=X" in caught.value.problem
    assert caught.value.found == "T_other, T_amb"


def test_some_rows_of_a_campaign(tmp_path):
    c = read_text(tmp_path, GOOD)
    part = c.rows(c.kind == Kind.DISTANCE)
    assert part.n == 1
    assert set(part.setups) == {"ball bar"}
    assert part.line.tolist() == [20]


def test_the_axes_without_a_model(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(GOOD)
    machine = bare_machine(path)
    assert machine.structure.axes == ("X", "Y", "Z")
    same(
        read_campaign(path, machine).rows(np.arange(4)),
        read_text(tmp_path, GOOD).rows(np.arange(4)),
    )
    path.write_text(GOOD.replace(",T_amb", ",(C)").replace(",T_x", ",B"))
    assert bare_machine(path).structure.rotary == ("B",)
    assert bare_machine(path).structure.spindle == "C"


def test_no_axes_at_all(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(GOOD.replace(",X,Y,Z,", ",x,y,z,"))
    with pytest.raises(InputError, match="no column of an axis") as caught:
        bare_machine(path)
    assert caught.value.line == 16


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "cp1252"])
def test_umlauts_are_kept_however_a_spreadsheet_saved_them(tmp_path, encoding):
    text = GOOD.replace("Bridge CMM", "Fräse Süd").replace("load none", "Spannkraft µ 5 %")
    text = text.replace("x_pos_1", "Größe übermäßig").replace("[setups.Gr", '[setups."Gr')
    text = text.replace("übermäßig]\n", 'übermäßig"]\n')
    path = tmp_path / "c.csv"
    path.write_bytes(text.encode(encoding))
    c = read_campaign(path, CMM)
    assert c.metadata[0]["machine"] == "Fräse Süd"
    assert "Spannkraft µ 5 %" in str(c.metadata[0]["notes"])
    assert "Größe übermäßig" in c.setups
    assert c.files == {str(path): hashlib.sha256(text.encode(encoding)).hexdigest()}
    np.testing.assert_array_equal(c.value, read_text(tmp_path, GOOD).value)


def test_chinese_names_are_kept(tmp_path):
    path = tmp_path / "c.csv"
    path.write_bytes(GOOD.replace("Bridge CMM", "车间七号").encode("gbk"))
    assert read_campaign(path, CMM).metadata[0]["machine"] == "车间七号"


def test_the_encoding_holds_for_all_pieces_of_a_file(tmp_path, monkeypatch):
    """The first umlaut stands far down; from there on the file is Windows-1252, and never UTF-8."""
    monkeypatch.setattr(lines_module, "CHUNK", 64)
    lines = GOOD.replace("ball bar", "Kugelstab").splitlines()
    row = lines[17].replace("x_pos_1", "Maß")
    path = tmp_path / "c.csv"
    path.write_bytes("\n".join([*lines, row, row]).encode("cp1252") + b"\n")
    assert list(read_campaign(path, CMM).setups)[-1] == "Maß"
    path.write_bytes(
        "\n".join([*lines, row]).encode("cp1252") + b"\n" + row.encode("utf-8") + b"\x81\n"
    )
    with pytest.raises(InputError, match="line 23: not text in one encoding"):
        read_campaign(path, CMM)
