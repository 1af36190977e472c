"""Bad images of tables, tapes and records of tables: refused in one line, in little memory."""

from __future__ import annotations

import io
import json
import lzma
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support.hostile import mutate
from tests.support.hostile.forked import Case, faults, run

GOOD = {"X.csv": "position,value\n0,0.1\n100,-0.2\n", "Y.csv": "position,value\n0,0\n"}


def good_image() -> bytes:
    """An image as `abbe.drivers.stores.image.pack` makes it, made here by hand."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(GOOD):
            info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            info.create_system = 3
            archive.writestr(info, GOOD[name].encode())
    return buffer.getvalue()


def unpack() -> None:
    """Read the image in this folder."""
    from abbe.drivers.stores.image import unpack as read

    assert read(Path("image").read_bytes()) == GOOD, "another content was taken for good"


def other(method: int, *contents: tuple[str, bytes]) -> Callable[[Path], None]:
    """Write another archive."""

    def made(path: Path) -> None:
        with zipfile.ZipFile(path, "w", method) as archive:
            for name, content in contents:
                archive.writestr(name, content)

    return made


def spoilt(path: Path) -> None:
    """Write an archive the head of which was overwritten."""
    other(zipfile.ZIP_LZMA, ("X.csv", b"0,1\n" * 1000))(path)
    content = bytearray(path.read_bytes())
    content[60:90] = b"\xff" * 30
    path.write_bytes(content)


def images() -> Iterator[Case]:
    """Archives that are no image, and damaged images."""
    huge = bytes(200_000_000)
    packed = other(zipfile.ZIP_LZMA, ("X.csv", b"0,1\n" * 1000))
    many = [(f"{i}.csv", b"") for i in range(9999)]
    named = [
        ("deflated bomb", other(zipfile.ZIP_DEFLATED, ("X.csv", huge))),
        ("bzip2 bomb", other(zipfile.ZIP_BZIP2, ("X.csv", huge))),
        ("LZMA bomb", other(zipfile.ZIP_LZMA, ("X.csv", huge))),
        ("LZMA", packed),
        ("LZMA spoilt", spoilt),
        ("no archive but LZMA", lzma.compress(b"0,1\n")),
        ("stored by another program", other(zipfile.ZIP_STORED, ("X.csv", b"0,1\n"))),
        ("a path", other(zipfile.ZIP_STORED, ("../X.csv", b"0,1\n"))),
        ("an absolute path", other(zipfile.ZIP_STORED, ("/etc/X.csv", b"0,1\n"))),
        ("not text", other(zipfile.ZIP_STORED, ("X.csv", b"\xff\xfe\x00"))),
        ("ten thousand files", other(zipfile.ZIP_STORED, *many)),
        ("more behind it", good_image() + b"more"),
        ("more before it", b"more" + good_image()),
    ]  # fmt: skip
    for name, content in named:
        yield Case(f"image: {name}", {"image": content}, unpack)
    good = good_image()
    for name, content in (
        *mutate.flipped(good, 40, 31), *mutate.cut(good, 12, 32),
        ("empty", b""), ("zero bytes", bytes(len(good))),
    ):  # fmt: skip
        yield Case(f"image: {name}", {"image": content}, unpack)


def tape() -> None:
    """Read the tape in this folder."""
    from abbe.drivers.stores.serial.tape_image import from_blocks

    blocks = Path("tape").read_text(encoding="latin-1").split("\n")
    assert from_blocks(blocks) == good_image(), "another content was taken for good"


def tapes() -> Iterator[Case]:
    """Tapes with blocks altered, lost or doubled."""
    from abbe.drivers.stores.serial.tape_image import to_blocks

    good = "\n".join(to_blocks(good_image())).encode()
    for name, content in (
        *mutate.flipped(good, 15, 33), *mutate.cut(good, 6, 34), *mutate.lines_mixed(good, 9, 35),
    ):  # fmt: skip
        same = content == good
        yield Case(f"tape: {name}", {"tape": content}, tape, may_succeed=same)


def load() -> None:
    """Read the set of tables in this folder."""
    from abbe.compcore.files.table_set import TableSet

    TableSet.load(".")


def record(**changes: object) -> str:
    """A record of tables with some keys changed; None takes one out."""
    import hashlib

    files = {n: hashlib.sha256(t.encode()).hexdigest() for n, t in GOOD.items()}
    document: dict[str, object] = {
        "format": "abbe-tables/1", "controller": "csv", "options": {}, "files": files,
        "sha256": "0" * 64, "tables": [], "notes": [],
    }  # fmt: skip
    document |= changes
    return json.dumps({k: v for k, v in document.items() if v is not None})


def records() -> Iterator[Case]:
    """Records of tables: wrong types, files elsewhere, damaged."""

    def case(name: str, text: str | bytes, *, may: bool = False) -> Case:
        files = {**GOOD, "abbe-tables.json": text}
        says = () if may else ("abbe-tables.json",)
        return Case(f"record: {name}", files, load, says, may)

    for key in ("format", "controller", "options", "files"):
        yield case(f"no {key}", record(**{key: None}))
        for wrong in (1, [], True, {"X.csv": 1}, "text"):
            if (key, wrong) not in (("controller", "text"), ("options", {"X.csv": 1})):
                yield case(f"{key} = {wrong}", record(**{key: wrong}))
    for name in ("../X.csv", "/etc/passwd", "a/../../X.csv", "", ".", "..", "X.csv\0", "x" * 5000):
        yield case(f"names {name[:20]!r}", record(files={name: "0" * 64}))
    for name, text in (
        ("deep", "[" * 200_000), ("deep objects", '{"a":' * 100_000), ("not JSON", "{"),
        ("a list", "[]"), ("a number", "1"), ("a long number", "9" * 100_000), ("NUL", "\0"),
    ):  # fmt: skip
        yield case(name, text)
    good = record().encode()
    for name, content in (
        *mutate.whole(good), *mutate.flipped(good, 25, 36), *mutate.cut(good, 8, 37),
        *mutate.harmless(good),
    ):  # fmt: skip
        yield case(name, content, may=True)


def unharmed() -> list[tuple[str, bytes, Callable[[], None]]]:
    """What must be read."""
    from abbe.drivers.stores.serial.tape_image import to_blocks

    blocks = "\n".join(to_blocks(good_image())).encode()
    return [("image", good_image(), unpack), ("tape", blocks, tape)]


CASES = [*images(), *tapes(), *records()]


@pytest.mark.one_in(12)
@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_bad_image_is_reported_in_one_line(case: Case, tmp_path: Path) -> None:
    outcome = run(case, tmp_path)
    assert not faults(case, outcome, tmp_path)


@pytest.mark.parametrize(("name", "content", "read"), unharmed(), ids=["image", "tape"])
def test_a_good_one_is_read(
    name: str, content: bytes, read: Callable[[], None], tmp_path: Path
) -> None:
    assert run(Case(name, {name: content}, read), tmp_path).status == 0
