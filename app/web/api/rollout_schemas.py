"""What machines send and receive, as `/openapi.json` describes it."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, Field

from app.services.rollouts.claims import HEARTBEAT_S
from app.services.rollouts.reports import LONGEST_REASON

from .request_schemas import Plain, Whole, _In, at_most

#: The longest wait of a call for work, in seconds: proxies end a call after a minute.
LONGEST_WAIT_S: Final = 50.0

Attempt = Annotated[
    int,
    Field(ge=1, le=1_000_000, description="The attempt of the claim; it names the lease."),
    Whole,
]
Reason = Annotated[
    Plain,
    Field(min_length=1, max_length=LONGEST_REASON, description="What happened, for experimenters."),
]


class ClaimWork(_In):
    """How a machine asks for work."""

    machine: Plain | None = Field(
        None, max_length=60, description="Its own name; if given, it must be that of the token."
    )
    environments: Annotated[list[Plain], at_most(20)] | None = Field(
        None, description="Only rollouts in these environments. Default: all of the study."
    )
    wait_s: float = Field(
        25.0,
        ge=0,
        le=LONGEST_WAIT_S,
        allow_inf_nan=False,
        description="How long to wait for work, in seconds.",
    )


class Beat(_In):
    """A heartbeat."""

    progress: float | None = Field(
        None, ge=0, le=1, allow_inf_nan=False, description="How far the run is, from 0 to 1."
    )
    attempt: Attempt | None = None


class Failed(_In):
    """The machine failed at a rollout; it may be tried again."""

    reason: Reason
    attempt: Attempt | None = None
    give_back: bool = Field(
        False, description="The machine was stopped and did not try: the attempt does not count."
    )


class Unsafe(_In):
    """The parameters must not be run: they are never proposed again."""

    reason: Reason


class Measurements(_In):
    """The machine's own numbers on the run: exported, never shown and never learnt from."""

    score: float | None = Field(None, allow_inf_nan=False)
    series: dict[str, Any] | None = Field(
        None, description="Any JSON object, such as {'time_s': [...], 'weight_g': [...]}."
    )
    attempt: Attempt | None = None


class RolloutLease(BaseModel):
    """How long the machine may be silent."""

    until: datetime
    seconds: float = Field(description="Seconds from now until then.")
    heartbeat_s: int = Field(HEARTBEAT_S, description="Send a heartbeat so often.")


class ClaimedRollout(BaseModel):
    """A rollout to run: set the parameters, run the machine, record the video, upload it."""

    id: str
    environment: str
    parameters: dict[str, float]
    seed: int
    run_index: int = Field(description="Number of the run of these parameters, from 0.")
    attempt: int = Field(description="Number of this claim of the rollout, from 1.")
    reason: Literal["query", "ahead", "acquired"] = Field(
        description="A pair waits for it, it may be needed next, or it is the result of a trial."
    )
    timeout_s: float = Field(description="A machine that is silent for so long has lost it.")
    lease: RolloutLease


class LeaseRenewed(BaseModel):
    """The answer to a heartbeat."""

    lease: RolloutLease
    stopped: bool = Field(description="Emergency stop: end the run, and give the rollout back.")


class RolloutStatus(BaseModel):
    """What became of the rollout: `asked` if it will be tried again."""

    status: Literal["asked", "claimed", "recorded", "failed", "unsafe", "cancelled", "withdrawn"]


class UploadTaken(RolloutStatus):
    """The recording has arrived."""

    kept: bool = Field(description="False if the rollout had ended otherwise meanwhile.")
    detail: str = ""


class UploadContinues(BaseModel):
    """A part of the recording has arrived."""

    received: int = Field(description="Bytes from its start that have arrived: go on from here.")
    total: int


class RolloutLine(BaseModel):
    """A rollout, as experimenters see it."""

    id: str
    environment: str
    candidate: int
    parameters: dict[str, float]
    run_index: int
    reason: str
    priority: int
    status: str
    attempt: int
    machine: str | None
    progress: float | None
    asked_at: datetime
    claimed_at: datetime | None
    lease_until: datetime | None
    ended_at: datetime | None
    explanation: str | None
    failures: list[dict[str, Any]]
    sha256: str | None
    score: float | None


class MachineLine(BaseModel):
    """A machine, as experimenters see it."""

    name: str
    connected: bool
    last_seen_at: datetime | None
    revoked_at: datetime | None


class Queue(BaseModel):
    """The machines of a study, and its rollouts, the newest first."""

    stopped_at: datetime | None
    machines: list[MachineLine]
    rollouts: list[RolloutLine]
    before: int | None = Field(description="`before` of the next page; null at the end.")
