"""What a plan may say of the stages around its comparisons."""

from typing import Annotated, Literal

from pydantic import Field, StrictInt

from app.study.part import Part

#: The practice's trial: before the first, and no trial of the plan.
PRACTICE_INDEX = -1
#: What the practice is called where a trial's condition or a query's type stands.
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
    """Pairs to learn the page by, drawn at random; their answers never reach a model."""

    queries: StrictInt = Field(
        default=0, ge=0, le=100, description="a whole number from 0 (none) to 100"
    )


class Resume(Part):
    """What happens to somebody who comes back to a session that they did not finish.

    Within `max_age_hours` of their last action everybody goes on where they were: a closed page, a
    refresh and a power cut look alike.
    """

    policy: Literal["resume", "restart", "block"] = Field(
        default="resume", description="resume, restart or block"
    )
    max_age_hours: Annotated[float, Field(ge=0.5, le=8760, allow_inf_nan=False)] | None = Field(
        default=None, description="a number of hours from 0.5 to 8760"
    )
