"""A set of files as one image for controllers that hold bytes: a plain, deterministic zip archive.

Stored, not compressed; names sorted; every date 1980-01-01: the same files always make the same
bytes, so that lengths and checksums of an image can be compared.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Mapping

from abbe.drivers.link import LinkProtocolError

_DATE = (1980, 1, 1, 0, 0, 0)
_UNIX = 3


class ImageError(LinkProtocolError):
    """Bytes that are not an image of text files, or files that cannot be in one."""


def crc32(image: bytes) -> int:
    """CRC-32 of ISO 3309 (as in zip, Ethernet; of the nine bytes ``123456789`` CBF43926h)."""
    return zlib.crc32(image)


def check_name(name: str) -> None:
    """Refuse what is not the plain name of a file.

    Raises
    ------
    ImageError
        For an empty name, a path, control characters.
    """
    wrong = not name or name in (".", "..") or any(c in '/\\:*?"<>|' or c < " " for c in name)
    if wrong or len(name) > 255 or not name.isprintable():
        raise ImageError(f"{name!r} is not the name of a file")


def pack(files: Mapping[str, str]) -> bytes:
    """Files (name → text) as one image.

    Raises
    ------
    ImageError
        For a name that is no file's, or text that is not Unicode.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(files):
            check_name(name)
            info = zipfile.ZipInfo(name, _DATE)
            info.create_system = _UNIX
            try:
                archive.writestr(info, files[name].encode("utf-8"))
            except UnicodeEncodeError as error:
                raise ImageError(f"{name}: not text: {error.reason}") from None
    return buffer.getvalue()


def unpack(image: bytes) -> dict[str, str]:
    """The files of an image; every checksum in it is verified.

    Raises
    ------
    ImageError
        When it is damaged, or not what `pack` makes.
    """
    files: dict[str, str] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(image)) as archive:
            for info in archive.infolist():
                check_name(info.filename)
                if info.compress_type != zipfile.ZIP_STORED or info.file_size > len(image):
                    raise ImageError(f"{info.filename} is not stored as it is in the image")
                if info.filename in files:
                    raise ImageError(f"{info.filename} is in the image twice")
                files[info.filename] = archive.read(info).decode("utf-8")
    except ImageError:
        raise
    except (zipfile.BadZipFile, OSError, EOFError, ValueError, RuntimeError, struct.error) as error:
        raise ImageError(f"not a whole image of tables: {error}") from None
    if pack(files) != image:
        raise ImageError("an image with more in it than its files")
    return files
