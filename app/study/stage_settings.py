"""Settings of the stages around the comparisons."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, StrictBool, StrictInt

from .plan_model import Part

#: Trial index of the practice, which is not a trial of the plan.
PRACTICE_INDEX = -1
#: Name of the practice in place of a trial's condition or a query's type.
PRACTICE = "practice"


class Familiarisation(Part):
    """The videos a person watches beforehand, drawn at random."""

    videos: StrictInt = Field(
        default=0, ge=0, le=1000, description="a whole number from 0 (none) to 1000"
    )
    required: StrictInt = Field(
        default=0, ge=0, le=1000, description="a whole number from 0 to the number of videos"
    )
    # Faster than 4x, a movement of a second is over in a few frames.
    speeds: tuple[Annotated[float, Field(ge=0.25, le=4, allow_inf_nan=False)], ...] = Field(
        default=(1.0, 2.0, 3.0, 4.0),
        min_length=1,
        max_length=8,
        description="a list of speeds from 0.25 to 4 such as [1, 2, 4], the first to begin with",
    )


class Practice(Part):
    """Practice pairs, drawn at random; their responses never reach a model."""

    queries: StrictInt = Field(
        default=0, ge=0, le=100, description="a whole number from 0 (none) to 100"
    )


class Resume(Part):
    """What happens when a participant returns to an unfinished session.

    Within `max_age_hours` of the last action every session continues: a closed page, a reload and a
    power cut cannot be distinguished.
    """

    policy: Literal["resume", "restart", "block"] = Field(
        default="resume", description="resume, restart or block"
    )
    max_age_hours: Annotated[float, Field(ge=0.5, le=8760, allow_inf_nan=False)] | None = Field(
        default=None, description="a number of hours from 0.5 to 8760"
    )


@dataclass(frozen=True)
class Device:
    """Measurements of a browser: width, whether the clip played to its end, and bandwidth."""

    width_px: int
    played: bool = False
    mbit_s: float | None = None


class DeviceCheck(Part):
    """Requirements that a device must meet before the study begins."""

    test_clip: StrictBool = Field(default=True, description="true or false")
    min_width_px: StrictInt | None = Field(
        default=None, ge=200, le=10_000, description="a whole number of pixels from 200 to 10000"
    )
    min_mbit_s: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)] | None = Field(
        default=None, description="a number of Mbit/s above 0"
    )

    def shortcomings(self, device: Device) -> tuple[str, ...]:
        """What the device lacks: any of width, clip and line."""
        found = []
        if self.min_width_px is not None and device.width_px < self.min_width_px:
            found.append("width")
        if self.test_clip and not device.played:
            found.append("clip")
        if self.min_mbit_s is not None and (device.mbit_s or 0) < self.min_mbit_s:
            found.append("line")
        return tuple(found)
