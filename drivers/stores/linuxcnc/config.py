"""The configuration section of a LinuxCNC's store; ``docs/upload.md`` is the user's page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationInfo, field_validator

from abbe.drivers.stores.base import StoreConfig


class LinuxCncStoreConfig(StoreConfig):
    """A LinuxCNC on this computer. Times are in s."""

    ini: str
    """Its INI file; relative to the folder of the configuration."""
    python: str = "/usr/bin/python3"
    """The Python to which LinuxCNC's modules belong."""
    timeout: Annotated[float, Field(gt=0, le=60)] = 5.0
    """Longest wait for LinuxCNC's answer."""
    restart: list[str] = Field(default_factory=list)
    """Command and arguments that end LinuxCNC and start it again, and return; none: a person does.
    It is run only while the machine is idle."""
    restart_timeout: Annotated[float, Field(gt=0, le=3600)] = 120.0
    """For LinuxCNC to be back."""
    max_correction: Annotated[float, Field(gt=0)] = 1.0
    """Largest correction that is accepted, in the file's unit (mm, inch, degree): a file of the
    other COMP_FILE_TYPE would move the machine by its positions."""
    watch: Annotated[float, Field(ge=0, le=3600)] = 0.0
    """How long the machine is watched for what the table does where it stands."""
    verify_by_moving: bool = False
    """Move each axis up and down again to see what the table does on both ways."""
    verify_step: Annotated[float, Field(gt=0, le=10)] = 1.0
    """mm or degrees."""
    verify_points: Annotated[int, Field(ge=1, le=10)] = 3
    """Steps each way."""
    verify_feed: Annotated[float, Field(gt=0, le=10000)] = 300.0
    """mm/min or degrees/min."""

    @field_validator("ini")
    @classmethod
    def _from_its_folder(cls, value: str, info: ValidationInfo) -> str:
        folder = (info.context or {}).get("folder", Path())
        return str((Path(folder) / Path(value).expanduser()).resolve())
