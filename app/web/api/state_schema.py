"""STATE, as `/openapi.json` describes it: where a session is, and what its stage shows.

A key that does not stand here is not sent: what an evaluator may know is listed, not what they may
not. Keys that do not apply are left out, never null.
"""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field

from app.study.stages import Stage


class Progress(BaseModel):
    """In numbers for people, from 1; trial 0 is before the first."""

    trial: int
    trials: int
    query: int
    queries: int
    at_most: bool | None = Field(
        default=None, description="true where a trial may end before its last query."
    )


class QueryWords(BaseModel):
    """The words of the study's own with which a pair is asked about and answered."""

    question: str | None = None
    left: str | None = None
    right: str | None = None


class StudyInState(BaseModel):
    """The study, as far as every page needs it."""

    slug: str
    title: str
    contact: str | None
    break_s: int = Field(description="Seconds of rest between two trials.")
    stages: list[str] = Field(description="The stages that this study has, in their order.")
    words: QueryWords | None = Field(None, description="Absent where they are the page's own.")


class Video(BaseModel):
    """A video to play."""

    url: str
    duration_s: float


class Text(BaseModel):
    """A text of the study as HTML."""

    html: str


class Consent(Text):
    """The consent text and its version."""

    version: str = Field(description="What an agreement has to name.")
    again: bool = Field(False, description="The text has changed since it was agreed to.")


class DeviceCheck(BaseModel):
    """What the device check requires."""

    clip: Video
    test_clip: bool = Field(description="Whether the clip has to be played.")
    min_width_px: int | None
    min_mbit_s: float | None


class Familiarisation(BaseModel):
    """The videos to watch before the comparisons."""

    videos: list[Video]
    required: int = Field(description="So many have to be watched to the end.")
    watched: list[int] = Field(description="Places in the list, from 0.")
    speeds: list[float]


class Reason(BaseModel):
    """A reason for a skip, or an answer, that can be chosen."""

    name: str
    label: str


class Skip(BaseModel):
    """The skip button."""

    label: str
    reasons: list[Reason] = Field(default=[], description="One of these may be given.")


class UndoOffer(BaseModel):
    """The response that can be undone, and for how long."""

    query_id: str
    seconds_left: float


class Query(BaseModel):
    """The open query."""

    id: str
    left: Video
    right: Video
    skip: Skip | None = Field(description="The skip button; null where there is none.")
    prefetch: list[str] = Field(description="Videos that may come next, the likeliest first.")
    practice: bool = False
    undo: UndoOffer | None = Field(None, description="While the last response can be taken back.")
    watch_once: bool = False


class Waiting(BaseModel):
    """What the open query waits for: machines record its videos."""

    since: str = Field(json_schema_extra={"format": "date-time"})
    usually_s: float | None = Field(
        description="The usual number of seconds of a recording; null before the first."
    )
    machines: int = Field(description="How many machines are connected.")
    left: Video | None = Field(description="The video on the left, if it is recorded already.")
    right: Video | None = Field(description="The video on the right, if it is recorded already.")
    undo: UndoOffer | None = Field(None, description="While the last response can be taken back.")


class Item(BaseModel):
    """An item of a questionnaire."""

    name: str
    type: str
    label: str
    required: bool
    points: int | None
    labels: list[str]
    min: float | None
    max: float | None
    choices: list[Reason] = Field(default=[], description="Of type choice: its name is sent.")


class Questionnaire(BaseModel):
    """The open questionnaire."""

    page: Literal["trial", "end"]
    items: list[Item]


class Break(BaseModel):
    """A break between two trials."""

    ends_at: str = Field(json_schema_extra={"format": "date-time"})
    seconds_left: int
    next_skip: Skip | None = Field(description="The skip button of the trial that comes next.")


class WayBack(BaseModel):
    """To the platform that the person came from."""

    code: str | None
    url: str | None
    platform: str | None
    fields: dict[str, str] = Field(default={}, description="What is sent there by POST.")


class SessionState(BaseModel):
    """STATE: where the session is. What its stage shows stands under the stage's name."""

    stage: Stage
    progress: Progress
    study: StudyInState
    language: str
    consent: Consent | None = None
    device_check: DeviceCheck | None = None
    instructions: Text | None = None
    familiarisation: Familiarisation | None = None
    query: Query | None = None
    waiting: Waiting | None = Field(
        None, description="In stage query, while the pair is not recorded yet; `query` is null."
    )
    questionnaire: Questionnaire | None = None
    break_: Break | None = Field(None, alias="break")
    debrief: Text | None = None
    completed: WayBack | None = None
    screened_out: WayBack | None = None
    withdrawn: WayBack | None = None
    declined: WayBack | None = None
    deleted: bool = Field(False, description="What the person gave is deleted.")


class Started(BaseModel):
    """A session that has just begun."""

    token: str
    receipt: str = Field(description="With this code what was given can be deleted later.")
    session: SessionState
