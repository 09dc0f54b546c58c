"""The reward for taking part."""

from typing import Annotated

from pydantic import Field, StrictStr

from .plan_model import Part


class Reward(Part):
    """What one completed session is worth; shown to experimenters, with what it comes to per hour.

    currency: an ISO 4217 code, since a sign such as $ says too little.
    """

    amount: Annotated[float, Field(strict=True, gt=0, le=1_000_000, allow_inf_nan=False)] = Field(
        description="an amount above 0 such as 4.5"
    )
    currency: StrictStr = Field(
        pattern=r"^[A-Z]{3}$", description="a code of three capital letters such as EUR"
    )

    def per_hour(self, minutes: float) -> float:
        """What it comes to per hour for a session of so many minutes, above 0."""
        return self.amount * 60 / minutes
