"""What a plan may say of the stages around its comparisons."""

from typing import Annotated

from pydantic import Field, StrictInt

from app.study.part import Part


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
