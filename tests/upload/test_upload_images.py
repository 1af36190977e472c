"""Images of files and tapes of images: what goes in comes out, and nothing else does."""

from __future__ import annotations

import io
import zipfile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.drivers.link import LinkProtocolError
from abbe.drivers.stores.image import ImageError, crc32, pack, unpack
from abbe.drivers.stores.serial.tape_image import from_blocks, to_blocks

NAMES = st.text(
    st.characters(codec="ascii", categories=("L", "N"), include_characters="._- "), min_size=1
).filter(lambda name: name not in (".", ".."))
SETS = st.dictionaries(NAMES, st.text(st.characters(exclude_categories=("Cs",))), max_size=5)


@given(files=SETS)
def test_files_come_back_byte_for_byte(files: dict[str, str]):
    image = pack(files)
    assert unpack(image) == files
    assert pack(dict(reversed(files.items()))) == image


@given(files=SETS.filter(bool), at=st.integers(0), flip=st.integers(1, 255))
def test_an_image_with_any_byte_altered_is_refused(files: dict[str, str], at: int, flip: int):
    image = bytearray(pack(files))
    image[at % len(image)] ^= flip
    with pytest.raises(ImageError):
        unpack(bytes(image))


@given(files=SETS.filter(bool), cut=st.integers(1))
def test_a_part_of_an_image_is_refused(files: dict[str, str], cut: int):
    image = pack(files)
    with pytest.raises(ImageError):
        unpack(image[: cut % len(image)])


@pytest.mark.parametrize("name", ["", ".", "..", "a/b", "../a", "a\\b", "a\0", "c:a", "a\n"])
def test_names_that_are_no_files(name: str):
    with pytest.raises(ImageError):
        pack({name: "x"})
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        info = zipfile.ZipInfo("x")
        info.filename = name
        archive.writestr(info, b"x")
    with pytest.raises(ImageError):
        unpack(buffer.getvalue())


def test_the_checksum_is_that_of_the_standard():
    assert crc32(b"123456789") == 0xCBF43926


@given(image=st.binary(min_size=1, max_size=400))
def test_tapes_give_the_image_back(image: bytes):
    blocks = to_blocks(image)
    assert from_blocks(blocks) == image
    assert all(b.isascii() and b.isprintable() and "%" not in b for b in blocks)


@given(image=st.binary(min_size=100, max_size=400), data=st.data())
def test_a_tape_with_a_block_lost_doubled_swapped_or_altered_is_refused(
    image: bytes, data: st.DataObject
):
    blocks = to_blocks(image)
    at = data.draw(st.integers(0, len(blocks) - 2))
    one = blocks[at]
    where = data.draw(st.integers(0, len(one) - 1))
    other = chr((ord(one[where]) + 1 - 33) % 94 + 33)
    for wrong in (
        blocks[:at] + blocks[at + 1 :],
        blocks[: at + 1] + blocks[at:],
        [*blocks[:at], blocks[at + 1], blocks[at], *blocks[at + 2 :]],
        [*blocks[:at], one[:where] + other + one[where + 1 :], *blocks[at + 1 :]],
    ):
        with pytest.raises(LinkProtocolError):
            from_blocks(wrong)
