"""What is expected of a machine without linear axes: no travel bounds its tool."""

from pathlib import Path

from abbe.daemon.config import load_config
from abbe.daemon.pipeline.reading.expected import expected_of
from tests.support.daemon.few_axes import write_machine

CONFIG = """format = "abbe-config/1"
model = "arm.toml"
[guard]
max_correction = 1.0
max_rate = 1.0
[axes.C]
source = "robot.c"
[axes.C2]
source = "robot.c2"
[links.robot]
driver = "serial"
port = "/dev/none"
[links.robot.messages.all]
query = "R"
pattern = '(?P<c>\\S+) (?P<c2>\\S+)'
[links.robot.channels]
c = { message = "all", unit = "deg" }
c2 = { message = "all", unit = "deg" }
"""


def test_an_arm_has_a_tool_although_no_axis_is_linear(tmp_path: Path) -> None:
    write_machine("arm", tmp_path)
    (tmp_path / "config.toml").write_text(CONFIG, "utf-8")
    expected = expected_of(load_config(tmp_path / "config.toml"), ("C", "C2"), {})
    # the links are 550 mm long, and where the tool is counts from the foot
    assert all(low < -550.0 and high > 550.0 for low, high in expected.tool)
