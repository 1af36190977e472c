"""The causes by which a virtual measurement errs, besides the machine's effects."""

from __future__ import annotations

OUTSIDE = "outside of what was measured"
SENSORS = "thermometers and other sensors"
PART_TEMPERATURE = "the part's temperature"
PART_EXPANSION = "the part's expansion coefficient"
REPEATABILITY = "repeatability of a touch"
TIP = "the tip's radius"
LOBING = "the probe's lobing"
SURFACE = "the part's surface"

NOT_MEASURED = " (not measured)"
"""Behind an effect: what the campaigns did not determine, as wide as it is believable."""
