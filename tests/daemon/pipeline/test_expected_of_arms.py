"""What is expected of a machine without linear axes: no travel bounds its tool."""

from pathlib import Path

from abbe.daemon.config import load_config
from abbe.daemon.pipeline.reading.expected import expected_of
from tests.support.daemon.few_axes import ARM_CONFIG, write_machine


def test_an_arm_has_a_tool_although_no_axis_is_linear(tmp_path: Path) -> None:
    write_machine("arm", tmp_path)
    (tmp_path / "config.toml").write_text(ARM_CONFIG, "utf-8")
    expected = expected_of(load_config(tmp_path / "config.toml"), ("C", "C2"), {})
    # the links are 550 mm long, and where the tool is counts from the foot
    assert all(low < -550.0 and high > 550.0 for low, high in expected.tool)
