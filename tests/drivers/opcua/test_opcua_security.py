"""Signed and encrypted sessions, users: who is not who he should be is not believed."""

from __future__ import annotations

import socket
import subprocess
from pathlib import Path

import pytest

from abbe.drivers.link import LinkConfigError, LinkState
from tests.support.drivers.opcua.mill import Mill, linked

pytestmark = pytest.mark.integration


def made(folder: Path, name: str) -> dict[str, str]:
    """A certificate and its key, made by the page's own command."""
    key, certificate = folder / f"{name}.key", folder / f"{name}.pem"
    subject = f"URI:urn:abbe:client,DNS:{socket.gethostname()}"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "3650",
         "-subj", "/CN=Abbe", "-addext", f"subjectAltName={subject}",
         "-addext", "keyUsage=digitalSignature,keyEncipherment,dataEncipherment",
         "-addext", "extendedKeyUsage=clientAuth",
         "-keyout", key, "-out", certificate],
        check=True, capture_output=True,
    )  # fmt: skip
    return {"certificate": str(certificate), "private_key": str(key)}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("security", ["sign", "encrypt"])
@pytest.mark.parametrize("policy", ["Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"])
async def test_signed_and_encrypted(
    server: Mill, tmp_path: Path, security: str, policy: str
) -> None:
    keys = made(tmp_path, "abbe") | {
        "security": security, "policy": policy, "server_certificate": str(server.certificate),
    }  # fmt: skip
    async with linked(server.url, {"x": "x"}, **keys) as link:
        found = (await link.read(("x",)))["x"]
        assert found.value == 1.5, found.reason
        assert link.status.state is LinkState.UP


async def test_a_server_with_another_certificate_is_not_believed(
    server: Mill, tmp_path: Path
) -> None:
    other = made(tmp_path, "other")["certificate"]
    keys = made(tmp_path, "abbe") | {"security": "sign", "server_certificate": other}
    async with linked(server.url, {"x": "x"}, timeout=1.0, **keys) as link:
        assert link.status.state is LinkState.DOWN
        assert not (await link.read(("x",)))["x"].good


async def test_users(server: Mill, tmp_path: Path) -> None:
    password = tmp_path / "password"
    password.write_text("sécret\n", encoding="utf-8")
    password.chmod(0o600)
    keys = made(tmp_path, "abbe") | {
        "security": "encrypt", "server_certificate": str(server.certificate),
        "user": "metrology", "password_file": str(password),
    }  # fmt: skip
    async with linked(server.url, {"x": "x"}, **keys) as link:
        assert (await link.read(("x",)))["x"].value == 1.5
    password.write_text("wrong", encoding="utf-8")
    async with linked(server.url, {"x": "x"}, **keys) as link:
        assert link.status.state is LinkState.DOWN
        assert "denied" in link.status.detail.lower() or "Identity" in link.status.detail
        assert "wrong" not in link.status.detail
    password.chmod(0o644)
    with pytest.raises(LinkConfigError, match="others may read this password; chmod 600"):
        async with linked(server.url, {"x": "x"}, **keys):
            pass


@pytest.mark.parametrize("broken", ["certificate", "private_key", "server_certificate"])
@pytest.mark.parametrize("how", ["missing", "rubbish"])
async def test_files_that_are_none(server: Mill, tmp_path: Path, broken: str, how: str) -> None:
    keys = made(tmp_path, "abbe") | {
        "security": "sign", "server_certificate": str(server.certificate),
    }  # fmt: skip
    keys[broken] = str(tmp_path / "none.pem")
    if how == "rubbish":
        (tmp_path / "none.pem").write_text("rubbish")
    with pytest.raises(LinkConfigError, match=r"none\.pem"):
        async with linked(server.url, {"x": "x"}, **keys):
            pass
