"""Bradley-Terry win rates of the candidates that were compared most often."""

from __future__ import annotations

from collections import Counter
from typing import Final

from sqlalchemy.orm import Session

from app.services.export.table import Request, points
from app.statistics.win_rates import win_rates

from .data import answers
from .result import Result, Row

#: Candidates shown for each environment; further ones rarely have enough comparisons.
MOST_COMPARED: Final = 12


def rates(db: Session, request: Request) -> Result:
    """Win rates over all evaluators and conditions, with one model for each environment."""
    games: dict[str, list[tuple[int, int]]] = {}
    for answer in answers(db, request):
        if answer.response != "skip" and not answer.is_check:
            pair = (answer.left, answer.right)
            won = pair if answer.response == "left" else pair[::-1]
            games.setdefault(answer.environment, []).append(won)
    by_candidate = points(db, request)
    names = [parameter.name for parameter in request.study.plan.parameters]
    rows: list[Row] = []
    for environment, played in games.items():
        number: Counter[int] = Counter(candidate for game in played for candidate in game)
        known = sorted(number)
        place = {candidate: index for index, candidate in enumerate(known)}
        found = win_rates(len(known), [(place[won], place[lost]) for won, lost in played])
        most = sorted(known, key=lambda candidate: (-number[candidate], candidate))[:MOST_COMPARED]
        for candidate in sorted(most, key=lambda c: -found[place[c]].value):
            rate = found[place[candidate]]
            rows.append(
                {
                    "environment": environment,
                    "candidate": candidate,
                    **dict(zip(names, by_candidate[environment, candidate], strict=True)),
                    "comparisons": rate.games,
                    "wins": rate.wins,
                    "win_rate": rate.value,
                    "low": rate.low,
                    "high": rate.high,
                }
            )
    if not rows:
        return Result((), "No choices yet.")
    best = max(rows, key=lambda row: row["win_rate"])
    says = (
        f"Of those compared most, candidate {best['candidate']} ({best['environment']}) wins most:"
        f" {best['win_rate']:.0%} [{best['low']:.0%}, {best['high']:.0%}] against the average."
    )
    note = (
        "Bradley and Terry's model over all choices; skips and checks are left out. Answers of one"
        " person are not independent, so the intervals are rather too narrow."
    )
    return Result(rows, says, (note,))
