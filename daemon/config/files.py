"""The files that a configuration has written: never one that it reads, never a foreign one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.files.text.write_target import WriteTarget
from abbe.daemon.config.configuration import Configuration
from abbe.daemon.outputs import JOURNAL, UPLOADS, OutputKind, require_kind
from abbe.daemon.socket_path import check_path

Key = tuple[str | int, ...]


def check_files(source: TomlSource, configuration: Configuration) -> None:
    """Refuse journals that would be written over something else.

    Parameters
    ----------
    source
        The file, for the places of errors.
    configuration
        What was read from it.

    Raises
    ------
    InputError
        For a journal on the configuration, the model or another journal, and on an existing file
        that is no journal.
    """
    if configuration.control_path is not None:
        try:
            check_path(configuration.control_path)
        except InputError as error:
            raise source.error(
                error.problem, ("control", "socket"), found=error.found, expected=error.expected
            ) from None
    taken = {
        WriteTarget.of(configuration.path).identity: "the configuration",
        WriteTarget.of(configuration.model_path).identity: "the model",
    }
    for path, kind, key, name in _written(configuration):
        try:
            target = WriteTarget.of(path)
            target.require_writable(path)
            require_kind(path, target, kind, force=False, way_out="another name")
        except InputError as error:
            raise source.error(
                f"{path}: {error.problem}", key, found=error.found, expected=error.expected
            ) from None
        if kind is UPLOADS and not target.replaced:
            raise source.error(
                "must be a file: it is read again",
                key,
                found=str(path),
                expected="a name of a file",
            )
        identity = target.identity
        if identity is None:
            continue
        if identity in taken:
            raise source.error(
                f"would be written onto {taken[identity]}",
                key,
                found=str(path),
                expected="a name of its own",
            )
        taken[identity] = name
    _check_buffer(source, configuration, taken)


def _check_buffer(
    source: TomlSource, configuration: Configuration, taken: dict[tuple[object, ...] | None, str]
) -> None:
    """What waits for a broker has a file of its own."""
    if configuration.mqtt is None:
        return
    if configuration.records_path is not None:
        taken[WriteTarget.of(configuration.records_path).identity] = "the records"
    path = configuration.mqtt.buffer
    if (identity := WriteTarget.of(path).identity) in taken:
        raise source.error(
            f"would be written onto {taken[identity]}",
            ("mqtt", "buffer"),
            found=str(path),
            expected="a name of its own",
        )


def _written(configuration: Configuration) -> Iterator[tuple[Path, OutputKind, Key, str]]:
    journal = configuration.journal_path
    if journal is not None:
        yield journal, JOURNAL, ("journal", "file"), "the journal"
        for number in range(1, configuration.file.journal.keep + 1):
            aside = journal.with_name(f"{journal.name}.{number}")
            if aside.exists():
                yield aside, JOURNAL, ("journal", "file"), "the journal"
    if configuration.upload is not None:
        yield configuration.upload.journal, UPLOADS, ("upload", "journal"), "the upload's journal"
