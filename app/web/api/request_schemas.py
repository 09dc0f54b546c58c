"""What the API takes, as `/openapi.json` describes it, and how it refuses."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
    model_validator,
)
from pydantic_core import PydanticCustomError

from app.services.sessions.event_limits import LONGEST_VALUE, MAX_EVENTS_PER_CALL, NAMES

#: No text has a NUL: PostgreSQL holds none, and every database takes the same.
Plain = Annotated[str, StringConstraints(pattern=r"^[^\x00]*$")]
Key = Annotated[Plain, StringConstraints(min_length=1, max_length=60)]
ExternalId = Annotated[Plain, StringConstraints(max_length=200)]


def _whole(value: object) -> object:
    """JSON has one kind of number: 2.0 is a whole one too."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


#: Comes last: bounds that stand before it are in the document too.
Whole = BeforeValidator(_whole)


#: Keys that are named in a refusal where an object has none such. More are counted before each of
#: them becomes a fault.
MOST_UNKNOWN: Final = 20


def _few(value: object, most: int) -> object:
    if isinstance(value, dict | list) and len(value) > most:
        entries = {"most": f"{most:,}", "came": f"{len(value):,}"}
        raise PydanticCustomError(
            "too_long", "Expected at most {most} entries, got {came}", entries
        )
    return value


def at_most(most: int) -> BeforeValidator:
    """Counts the entries of a list or an object before any of them is looked at."""
    return BeforeValidator(lambda value: _few(value, most))


class _In(BaseModel):
    # As described: a number is no text, and false is no number.
    model_config = ConfigDict(extra="forbid", strict=True)

    @model_validator(mode="before")
    @classmethod
    def _has_few_keys(cls, value: object) -> object:
        return _few(value, len(cls.model_fields) + MOST_UNKNOWN)


class StartSession(_In):
    """How a session begins."""

    external_ids: Annotated[dict[Key, ExternalId], at_most(20)] = Field(
        default_factory=dict,
        max_length=20,
        description="What a platform calls the participant: the parameters of the platform that"
        " the study's plan names, and no others.",
    )
    entry: Plain | None = Field(
        None, max_length=64, description="Token of a single-use link, where the study wants one."
    )
    mode: Literal["live", "preview", "pilot", "simulated"] = "live"
    language: Plain | None = Field(None, max_length=12)


class GiveConsent(_In):
    """Agreement to the consent text of a version."""

    version: Plain = Field(max_length=64, description="Version of the text that is agreed to.")


class MeasuredDevice(_In):
    """What a page's device check has measured."""

    width_px: Annotated[
        int, Field(ge=0, le=100_000, description="Width of the page in CSS pixels."), Whole
    ]
    played: bool = Field(False, description="Whether the test clip played to its end.")
    mbit_s: float | None = Field(None, ge=0, le=1e6, allow_inf_nan=False)


class GoOn(_In):
    """Leaving a page, with the device check's measurements where there are any."""

    device: MeasuredDevice | None = Field(None, description="In stage device_check.")


class Watched(_In):
    """A familiarisation video watched to its end."""

    index: Annotated[
        int, Field(ge=0, le=1_000, description="Place of the video in the list, from 0."), Whole
    ]


class Answers(_In):
    """Answers to the open questionnaire, by the names of its items."""

    answers: Annotated[dict[Key, Plain | int | float | None], at_most(100)] = Field(max_length=100)


class Happened(_In):
    """Something the browser saw while the query was on the screen."""

    event: Plain = Field(
        min_length=1, max_length=40, description=f"One of {', '.join(sorted(NAMES))}."
    )
    side: Literal["left", "right"] | None = None
    time_ms: float = Field(ge=0, le=1e9, allow_inf_nan=False)
    value: Plain | float | int | bool | None = Field(None)

    @property
    def text(self) -> str | None:
        return None if self.value is None else str(self.value)[:LONGEST_VALUE]


#: What is looked at of the events of one call: the first ones, and the last, which tell how much
#: was watched. The others are counted.
LAST_EVENTS: Final = 20
FIRST_EVENTS: Final = MAX_EVENTS_PER_CALL - LAST_EVENTS
_LEFT_OUT = "events_left_out"
_EVENTS = (
    f"What was seen. Of more than {MAX_EVENTS_PER_CALL}, the first {FIRST_EVENTS} and the last"
    f" {LAST_EVENTS} are kept; the others, and those of other names, are counted."
)


def _few_events(value: object) -> object:
    """A body with the events that are looked at, and the number of those left out."""
    if not isinstance(value, dict) or not isinstance(value.get("events"), list):
        return value
    events, said = value["events"], value.get(_LEFT_OUT, 0)
    more = len(events) - FIRST_EVENTS - LAST_EVENTS
    if more <= 0 or not isinstance(said, int):
        return value
    kept = [*events[:FIRST_EVENTS], *events[-LAST_EVENTS:]]
    return {**value, "events": kept, _LEFT_OUT: said + more}


#: How a page says that more happened than it sends. An answer is taken however much it was.
LeftOut = Annotated[
    int, Field(ge=0, le=1_000_000, description="Events that were seen and are not sent."), Whole
]


class Respond(BaseModel):
    """A response. Fields that are not known yet are taken and let go."""

    model_config = ConfigDict(extra="ignore", strict=True)

    query_id: Plain = Field(min_length=1, max_length=64)
    response: Literal["left", "right", "skip"]
    rt_ms: float | None = Field(
        None,
        ge=0,
        le=1e9,
        allow_inf_nan=False,
        description="Milliseconds from both videos having begun to play to the press.",
    )
    replays: Annotated[int, Field(ge=0, le=100_000), Whole] | None = None
    skip_reason: Plain | None = Field(None, max_length=60)
    events: list[Happened] = Field(default_factory=list, description=_EVENTS)
    events_left_out: LeftOut = 0

    _bounded = model_validator(mode="before")(_few_events)


class Leave(_In):
    """How somebody leaves."""

    delete: bool = Field(False, description="Delete what the person gave, instead of keeping it.")


class AskForDeletion(_In):
    """Deletion by a receipt code."""

    receipt: Plain = Field(
        min_length=1, max_length=64, description="The code that was given with the session."
    )


class Undo(_In):
    """The response to this query is taken back."""

    query_id: Plain = Field(min_length=1, max_length=64)


class ReportFault(_In):
    """A video of a query did not play."""

    query_id: Plain = Field(min_length=1, max_length=64)
    reason: Plain = Field("", max_length=200, description="What was seen of the fault.")
    events: list[Happened] = Field(default_factory=list, description=_EVENTS)
    events_left_out: LeftOut = 0

    _bounded = model_validator(mode="before")(_few_events)
