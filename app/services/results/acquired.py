"""The acquired candidates of finished trials, by their position in W."""

from __future__ import annotations

from sqlalchemy.orm import Session

from app.services.export.table import Request, points
from app.services.studies.candidate_scores import mean_scores

from .data import acquired_rows, answers
from .result import Result, Row


def on_w(db: Session, request: Request) -> Result:
    """The candidate that each finished trial ended with."""
    by_candidate = points(db, request)
    of_score = mean_scores(db, request.study.id)
    names = [parameter.name for parameter in request.study.plan.parameters]
    last = {(at.session, at.trial): at for at in acquired_rows(db, request) if at.finished}
    rows: list[Row] = [
        {
            "session_id": at.session,
            "participant_id": at.participant,
            "trial_index": at.trial,
            "condition": at.condition,
            "environment": at.environment,
            "candidate": at.candidate,
            **dict(zip(names, by_candidate[at.environment, at.candidate], strict=True)),
            "score": of_score.get((at.environment, at.candidate)),
        }
        for at in last.values()
    ]
    if not rows:
        return Result((), "No trial is finished yet.")
    different = len({(row["environment"], row["candidate"]) for row in rows})
    says = f"{len(rows)} finished trials ended with {different} different candidates."
    ground = of_score or _shown(db, request)
    return Result(
        rows,
        says,
        extra={
            "points": by_candidate,
            "ground": ground,
            "ground_title": "mean score" if of_score else "times shown",
        },
    )


def _shown(db: Session, request: Request) -> dict[tuple[str, int], float]:
    shown: dict[tuple[str, int], float] = {}
    for answer in answers(db, request):
        for candidate in (answer.left, answer.right):
            key = (answer.environment, candidate)
            shown[key] = shown.get(key, 0.0) + 1.0
    return shown
