"""Pointing files of telescopes: what a star says of the mount, one by one and of a whole night."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.importers.placing import ForeignPlacing
from abbe.compcore.files.importers.tpoint import import_tpoint
from abbe.compcore.files.model_file import load_model

SKY = Path(__file__).parents[2] / "data" / "real" / "r01-telescope"
HEAD = "! comment\nMade up\n: ALTAZ\n+31 41 19.6 2021 8 21 13.0 741 2608.0 0.75\n"


def written(folder: Path, *stars: tuple[float, ...], head: str = HEAD) -> Path:
    path = folder / "stars.dat"
    rows = "".join(" ".join(f"{v:.12f}" for v in star) + "\n" for star in stars)
    path.write_text(head + rows + "END\nleft over\n", encoding="utf-8")
    return path


def rows(campaign: Campaign) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(campaign.conditions.u), campaign.value


@pytest.mark.parametrize("azimuth", [0.0, 40.0, 200.0, -75.0])
@pytest.mark.parametrize("elevation", [15.0, 60.0])
def test_a_star_says_how_far_the_telescope_is_turned(
    tmp_path: Path, azimuth: float, elevation: float
) -> None:
    """It looks 20 µrad higher than it reads, and 30 µrad further round: two rotations."""
    up, round_ = np.rad2deg(20e-6), np.rad2deg(30e-6)
    path = written(tmp_path, (azimuth + round_, elevation + up, azimuth, elevation))
    campaign = import_tpoint(path)
    assert set(campaign.kind.tolist()) == {int(Kind.ROTATION)}
    assert campaign.line.tolist() == [5, 5]
    u, value = rows(campaign)
    a, e = np.deg2rad([azimuth, elevation])
    level = np.array([-np.sin(a), np.cos(a), 0.0])
    looks = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    assert np.abs(u @ looks).max() < 1e-12
    # about the level axis, right-handed, it would sink
    turned = -20e-6 * level + 30e-6 * np.array([0.0, 0.0, 1.0])
    assert value == pytest.approx(u @ turned, abs=2e-9)


def test_an_encoder_s_zero_is_taken_off_and_said(tmp_path: Path) -> None:
    stars = [(a, 45.0, a - 359.6, 45.0) for a in (10.0, 130.0, 250.0)]
    campaign = import_tpoint(written(tmp_path, *stars))
    assert np.abs(campaign.value).max() < 1e-12
    assert "zero of the azimuth: -0.400000 degrees" in str(campaign.metadata[0]["notes"])
    assert "zero of the elevation" not in str(campaign.metadata[0]["notes"])


def test_a_caption_that_is_written_as_a_comment_is_none(tmp_path: Path) -> None:
    """As the Euler telescope's: the options behind it are options all the same."""
    head = "! Pointing Data for ECAM\n:ALTAZ\n:NODA\n-29 15 24.0\n\n"
    campaign = import_tpoint(written(tmp_path, (20.0, 45.0, 20.0, 45.0), head=head))
    assert campaign.n == 2
    assert "(TPOINT: no caption)" in str(campaign.metadata[0]["notes"])
    with pytest.raises(InputError, match="found 'NODA', expected a line ': ALTAZ'"):
        import_tpoint(
            written(tmp_path, (20.0, 45.0, 20.0, 45.0), head=head.replace(":ALTAZ\n", ""))
        )


def test_another_night_with_the_zero_of_the_first_shows_that_the_axis_moved(tmp_path: Path) -> None:
    """The second night's azimuth reads 40 µrad less: what was taken off the first shows it."""
    moved = float(np.rad2deg(40e-6))
    first = [(a, 45.0, a - 0.4, 45.1) for a in (10.0, 130.0, 250.0)]
    second = [(a, e, read - moved, up) for a, e, read, up in first]
    notes = str(import_tpoint(written(tmp_path, *first)).metadata[0]["notes"])
    assert "other nights of the same telescope: --zero 0.400000,-0.100000" in notes

    alone = import_tpoint(written(tmp_path, *second))
    assert np.abs(alone.value).max() < 1e-8  # hidden in its own zero, but for its rounding
    beside = import_tpoint(written(tmp_path, *second), zero=(0.4, -0.1))
    said = str(beside.metadata[0]["notes"])
    assert "zero of the azimuth: 0.400000 degrees" in said
    assert "--zero" not in said
    # about the upward axis across the line of sight, at 45 degrees
    assert np.abs(beside.value[1::2]) == pytest.approx(40e-6 * np.cos(np.deg2rad(45.0)), rel=1e-3)


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("", None, "not a pointing file"),
        ("Caption\n", None, "not a pointing file"),
        (HEAD.replace(": ALTAZ", ": EQUAT") + "1 2 1 2\n", 4, "not an alt-azimuth mount"),
        (HEAD.replace(": ALTAZ\n", "") + "1 2 1 2\n", 3, "not an alt-azimuth mount"),
        (HEAD + "18 55 20.1 +43 56 46.0 18 55 20 43 56 40 19 11.4\n", 5, "not a pointing file"),
        (HEAD + "10 20 10 x\n", 5, "elevation read"),
        (HEAD + "10 120 10 20\n", 5, "elevation"),
        (HEAD + "10 nan 10 20\n", 5, "elevation"),
        (HEAD, None, "no stars"),
    ],
)
def test_what_is_no_such_file_is_refused_in_one_sentence(
    tmp_path: Path, text: str, line: int | None, said: str
) -> None:
    path = tmp_path / "stars.dat"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as found:
        import_tpoint(path)
    assert found.value.line == line
    assert said in str(found.value)
    assert "\n" not in str(found.value)


def test_a_real_night_told_as_stars_comes_back_as_it_was(tmp_path: Path) -> None:
    """86 stars of the MMT: where each stood, by vectors, from what was measured of the mount."""
    model = load_model(SKY / "model.toml")
    night = read_campaign(SKY / "run.csv", model.machine)
    joints = night.conditions.positions
    azimuth, elevation = joints["C"], np.pi / 2 - joints["B"]
    looks = np.column_stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    # two components of one star stand in rows that follow one another
    turned = (np.asarray(night.conditions.u) * night.value[:, None]).reshape(-1, 2, 3).sum(axis=1)
    star = looks[::2] + np.cross(turned, looks[::2])
    star /= np.linalg.norm(star, axis=1, keepdims=True)
    stars = np.column_stack(
        [
            np.rad2deg(np.arctan2(star[:, 1], star[:, 0])),
            np.rad2deg(np.arcsin(star[:, 2])),
            np.rad2deg(azimuth[::2]),
            np.rad2deg(elevation[::2]),
        ]
    )
    placing = ForeignPlacing(at={"Z": 0.0})
    campaign = import_tpoint(written(tmp_path, *stars), placing, machine=model.machine)
    assert campaign.n == night.n
    found = (np.asarray(campaign.conditions.u) * campaign.value[:, None]).reshape(-1, 2, 3)
    assert np.abs(found.sum(axis=1) - turned).max() < 5e-9
