"""What a plan may say of the stages around its comparisons."""

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
