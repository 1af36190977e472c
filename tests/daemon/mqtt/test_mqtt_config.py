"""``[mqtt]``: what cannot work is refused by name; what is confined may reach its broker."""

from __future__ import annotations

import importlib.util
import re
import shutil
from pathlib import Path

import pytest

from abbe.compcore.errors import InputError
from abbe.daemon.config import load_config
from abbe.daemon.config.sections.mqtt import MqttSection
from abbe.daemon.mqtt.messages import PARTS
from abbe.daemon.status.run_status import RunStatus
from abbe.daemon.systemd.install import plan
from tests.daemon.pipeline.test_live_control import EXAMPLE
from tests.support.daemon.command_line import abbe

PAGE = (Path(__file__).parents[3] / "docs" / "mqtt.md").read_text("utf-8")
TLS = 'url = "mqtts://10.1.2.3"'


def written(folder: Path, section: str) -> Path:
    shutil.copytree(EXAMPLE, folder, dirs_exist_ok=True)
    path = folder / "config.toml"
    path.write_text(path.read_text("utf-8") + f"\n[mqtt]\n{section}\n", "utf-8")
    (folder / "there").write_text("secret", "utf-8")
    return path


@pytest.mark.parametrize(
    ("section", "why"),
    [
        ("", "url"),
        ('url = "http://10.1.2.3"', "not a broker"),
        ('url = "mqtt://10.1.2.3:99999"', "not a broker"),
        ('url = "mqtt://me:secret@10.1.2.3"', "not a broker"),
        ('url = "mqtt://10.1.2.3/path"', "not a broker"),
        (f'{TLS}\ntopic = "plant/#"', "not a topic"),
        (f'{TLS}\ntopic = "$SYS/abbe"', "not a topic"),
        (f'{TLS}\ntopic = "a//b"', "not a topic"),
        (f'{TLS}\ntopic = "a\\u0000b"', "not a topic"),
        (f'{TLS}\nuser = "me"', "go together"),
        (f'{TLS}\ncertificate = "there"', "go together"),
        (f'{TLS}\nca = "nowhere.pem"', "no such file"),
        (f"{TLS}\nreconnect_min = 100.0", "below reconnect_min"),
        (f'{TLS}\nversion = "4"', "version"),
        (f'{TLS}\nbuffer = "here.txt"', "buffer"),
        (f'{TLS}\nbuffer = "r.sqlite"\n[records]\nfile = "r.sqlite"', "onto the records"),
        ('url = "mqtt://10.1.2.3"\nca = "there"', "mqtts"),
        (
            'url = "mqtt://10.1.2.3"\nuser = "me"\npassword_file = "there"',
            "in the clear is everybody's",
        ),
    ],
)
def test_what_cannot_work(tmp_path: Path, section: str, why: str) -> None:
    with pytest.raises(InputError, match=why) as raised:
        load_config(written(tmp_path, section))
    assert "config.toml" in str(raised.value)


def test_without_its_package_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "aiomqtt" else real(name)
    )
    with pytest.raises(InputError, match=re.escape("pip install 'abbe[mqtt]'")):
        load_config(written(tmp_path, TLS))


def test_what_it_becomes(tmp_path: Path) -> None:
    configuration = load_config(written(tmp_path, TLS))
    setup = configuration.mqtt
    assert setup is not None
    assert (setup.host, setup.port) == ("10.1.2.3", 8883)
    assert setup.topic == f"abbe/{configuration.model.machine.name}"
    assert setup.buffer == tmp_path / "mqtt.sqlite"
    assert setup.resource == "tcp 10.1.2.3:8883"


def test_abbe_check_says_where_it_is_published(tmp_path: Path) -> None:
    done = abbe("check", written(tmp_path, TLS))
    assert done.status == 0, done.err
    assert "Published: every 5 s to mqtts://10.1.2.3, below abbe/Bridge CMM" in done.out


def test_the_page_tells_every_key_and_topic() -> None:
    for key, field in MqttSection.model_fields.items():
        assert f"`{key}`" in PAGE, key
        if isinstance(field.default, float | int):
            row = next(
                line for line in PAGE.splitlines() if line.startswith("|") and f"`{key}`" in line
            )
            stated = [float(n.replace(" ", "")) for n in re.findall(r"\d[\d ]*(?:\.\d+)?", row)]
            assert float(field.default) in stated, row
    for topic, parts in PARTS.items():
        assert f"`{topic}`" in PAGE
        for part in parts:
            assert part in RunStatus.model_fields
            assert f"`{part}`" in PAGE, part


def test_a_confined_service_may_reach_its_broker(tmp_path: Path) -> None:
    source = written(tmp_path / "source", TLS)
    made = plan(load_config(source), "mill", tmp_path / "root", tmp_path / "abbe")
    texts = [str(content) for path, content in made.files.items() if path.suffix == ".conf"]
    assert any("IPAddressAllow=10.1.2.3" in text for text in texts)
    assert any("SystemCallFilter=setpriority" in text for text in texts)
