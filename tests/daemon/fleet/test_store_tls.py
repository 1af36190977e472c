"""A real PostgreSQL behind TLS: only one that proves who it is gets what a machine says."""

from __future__ import annotations

import datetime
import ipaddress
import os
import socket
import ssl
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import psycopg
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from typer.testing import CliRunner

from abbe.compcore.errors import AbbeError
from abbe.daemon.application import application
from abbe.daemon.fleet.store import connecting
from abbe.daemon.fleet.store.connecting import one_line, opened_store
from tests.support.daemon.plant_store import MachineRecords, store
from tests.support.daemon.postgres import PostgreSQL

pytestmark = [pytest.mark.integration, pytest.mark.xdist_group("postgresql")]

HERE = x509.IPAddress(ipaddress.ip_address("127.0.0.1"))
ELSEWHERE = x509.DNSName("store.other.example")
DAY = datetime.timedelta(days=1)
REFUSED = {
    "another's": "certificate verify failed",
    "of another name": "does not match host name",
    "expired": "certificate verify failed",
    "none": "does not support SSL",
}
"""The store's certificate → what is said of it."""


def certificate(file: Path, name: x509.GeneralName, since: int, until: int) -> tuple[Path, bytes]:
    """A certificate that vouches for itself, from and to so many days from now; and its key."""
    key = ec.generate_private_key(ec.SECP256R1())
    called = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, file.stem)])
    now = datetime.datetime.now(datetime.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(called)
        .issuer_name(called)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now + since * DAY)
        .not_valid_after(now + until * DAY)
        .add_extension(x509.SubjectAlternativeName([name]), critical=False)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    file.write_bytes(made.public_bytes(serialization.Encoding.PEM))
    return file, key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


class SecuredStore:
    """A store whose certificate can be changed while it runs."""

    def __init__(self, server: PostgreSQL, folder: Path) -> None:
        self.server = server
        self.made = {
            "right": certificate(folder / "right.crt", HERE, -1, 2),
            "another's": certificate(folder / "other.crt", HERE, -1, 2),
            "of another name": certificate(folder / "name.crt", ELSEWHERE, -1, 2),
            "expired": certificate(folder / "old.crt", HERE, -3, -1),
        }

    def authority(self, kind: str) -> Path:
        """What a client would have to trust to believe such a store, were it right otherwise."""
        return self.made["right" if kind in ("another's", "none") else kind][0]

    def shows(self, kind: str) -> None:
        """Have it show this certificate; returns when it does."""
        folder = self.server.folder
        if kind != "none":
            chain, key = self.made[kind]
            for name, content in (("server.crt", chain.read_bytes()), ("server.key", key)):
                (folder / name).write_bytes(content)
                (folder / name).chmod(0o600)
                if os.geteuid() == 0:
                    os.chown(folder / name, folder.stat().st_uid, folder.stat().st_gid)
        wanted = "off" if kind == "none" else "on"
        with self.server.connected() as connection:
            connection.execute(f"ALTER SYSTEM SET ssl = {wanted}".encode())
            connection.execute("SELECT pg_reload_conf()")
        shown = "" if kind == "none" else self.made[kind][0].read_text("ascii")
        deadline = time.monotonic() + 30.0
        while self._shown() != shown:
            assert time.monotonic() < deadline
            time.sleep(0.02)

    def _shown(self) -> str:
        """The certificate that a new client is shown, as PEM; empty: none."""
        with socket.create_connection(("127.0.0.1", self.server.port), 5.0) as wire:
            wire.sendall(b"\0\0\0\x08\x04\xd2\x16\x2f")  # PostgreSQL's SSLRequest
            if wire.recv(1) != b"S":
                return ""
            context = ssl.create_default_context()
            context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
            with context.wrap_socket(wire) as inside:
                return ssl.DER_cert_to_PEM_cert(inside.getpeercert(binary_form=True) or b"")


@pytest.fixture(scope="module")
def secured(server: PostgreSQL, tmp_path_factory: pytest.TempPathFactory) -> Iterator[SecuredStore]:
    with store(server, "secured"):
        found = SecuredStore(server, tmp_path_factory.mktemp("pem"))
        yield found
        found.shows("none")


@pytest.fixture
def records(tmp_path: Path) -> MachineRecords:
    found = MachineRecords(tmp_path / "mill-7")
    found.run(0)
    found.events(0, 3)
    return found


def test_a_store_that_proves_who_it_is(secured: SecuredStore, records: MachineRecords) -> None:
    secured.shows("right")
    tls = {"tls": True, "ca": str(secured.authority("right"))}
    records.uploader(secured.server.port, "secured", **tls).once()
    with secured.server.connected(database="secured") as connection:
        assert connection.execute("SELECT count(*) FROM abbe.events").fetchone() == (3,)


@pytest.mark.parametrize("kind", REFUSED)
def test_any_other_is_told_nothing(
    kind: str, secured: SecuredStore, records: MachineRecords
) -> None:
    secured.shows(kind)
    ca = str(secured.authority(kind))
    with pytest.raises(psycopg.OperationalError) as refused:
        records.uploader(secured.server.port, "secured", tls=True, ca=ca).once()
    assert REFUSED[kind] in one_line(refused.value)
    url = f"{secured.server.url(database='secured')}?sslmode=verify-full&sslrootcert={ca}"
    done = CliRunner().invoke(application("fleet"), ["fleet", "--store", url])
    assert done.exit_code
    assert isinstance(done.exception, AbbeError)
    assert REFUSED[kind] in str(done.exception)
    assert "\n" not in str(done.exception)


def test_without_a_file_the_computer_s_own_authorities_count(
    secured: SecuredStore, records: MachineRecords, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Where Python looks for them: psycopg's own OpenSSL would look where nothing is."""
    secured.shows("right")
    for name in ("SSL_CERT_FILE", "SSL_CERT_DIR"):
        monkeypatch.setenv(name, "x")
        monkeypatch.delenv(name)

    def of_the_computer(file: Path) -> None:
        for name in ("SSL_CERT_FILE", "SSL_CERT_DIR"):
            monkeypatch.delenv(name, raising=False)
        paths = SimpleNamespace(
            openssl_cafile_env="SSL_CERT_FILE", openssl_cafile=str(file),
            openssl_capath_env="SSL_CERT_DIR", openssl_capath=str(tmp_path),
        )  # fmt: skip
        monkeypatch.setattr(connecting.ssl, "get_default_verify_paths", lambda: paths)

    of_the_computer(secured.authority("right"))
    records.uploader(secured.server.port, "secured", tls=True).once()
    of_the_computer(secured.authority("of another name"))
    with pytest.raises(psycopg.OperationalError, match="certificate verify failed"):
        records.uploader(secured.server.port, "secured", tls=True).once()


@pytest.mark.parametrize(
    ("url", "environment", "wanted"),
    [
        ("postgresql://me@store.plant.example/abbe", {}, "verify-full"),
        ("postgresql://me@10.0.0.5/abbe", {}, "verify-full"),
        ("postgresql:///abbe", {"PGHOST": "10.0.0.5"}, "verify-full"),
        ("postgresql://me@127.0.0.1/abbe", {}, None),
        ("postgresql:///abbe?host=/run/postgresql", {}, None),
        ("postgresql://me@10.0.0.5/abbe?sslmode=require", {}, "require"),
        ("postgresql://me@10.0.0.5/abbe", {"PGSSLMODE": "verify-ca"}, None),
    ],
)
def test_over_a_network_a_person_s_connection_demands_proof(
    url: str, environment: dict[str, str], wanted: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("PGHOST", "PGSSLMODE", "PGSERVICE", "PGSSLROOTCERT"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    asked: dict[str, object] = {}

    def connect(**keys: object) -> None:
        asked.update(keys)
        raise psycopg.OperationalError("that far")

    monkeypatch.setattr(connecting.psycopg, "connect", connect)
    with pytest.raises(AbbeError, match="that far"), opened_store(url):
        pass
    assert asked.get("sslmode") == wanted
