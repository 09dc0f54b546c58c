"""A trial that began under an earlier engine goes on under the settings of that engine."""

from __future__ import annotations

import pytest
from sqlalchemy import select, update

from app.pbbo import ENGINE_VERSION, Settings
from app.services.context import AppContext
from app.services.sessions import replay
from app.storage.models.studies import QueryRow, Trial
from tests.conftest import SHORT_PLAN, Clock, StudyShelf

from .client import Api

PLAN = SHORT_PLAN.replace(
    """    method: pbpo
    environment: env1
    skip: {label: {en: I don't like either.}}
    settings: {preset: paper-env1}
""",
    """    method: pbpo-threshold
    environment: env1
    skip: {label: {en: I don't like either.}}
""",
)


def asked(app: AppContext) -> list[tuple[str, str]]:
    """Engine and acquisition of every query of the threshold's trials, in order."""
    with app.database.read() as db:
        rows = db.execute(
            select(QueryRow.engine_version, QueryRow.acquisition)
            .join(Trial, QueryRow.trial_id == Trial.id)
            .where(Trial.method == "pbpo-threshold")
            .order_by(QueryRow.query_index)
        )
        return [(engine, acquisition) for engine, acquisition in rows]


@pytest.mark.parametrize("stored", ["2", ENGINE_VERSION])
def test_a_trial_goes_on_under_the_engine_that_it_began_under(
    client: Api, app: AppContext, study_shelf: StudyShelf, clock: Clock, stored: str
) -> None:
    study_shelf.put_into(app, PLAN)
    session = client.start().to_first_query()
    while not asked(app):
        session.step("left", clock.forward)
    with app.database.write() as database:
        database.execute(update(QueryRow).values(engine_version=stored))
        seeds = frozenset(database.scalars(select(Trial.seed)))
    # What was worked out ahead was worked out before the database said so.
    app.proposer.evict(seeds)

    for _ in range(3):
        session.step("left", clock.forward)

    at_first = "random" if stored == "2" else "covering"
    assert asked(app)[1:4] == [(stored, at_first)] * 3
    if stored == ENGINE_VERSION:
        [threshold] = [trial for trial in replay.replay(app, "short") if trial.condition == "pbpo"]
        assert threshold.differences == ()


def test_what_a_plan_sets_itself_holds_under_every_engine() -> None:
    plan = {"threshold_epsilon": 0.2}

    earlier, now = Settings.from_mapping(plan, "2"), Settings.from_mapping(plan)

    assert earlier.threshold_epsilon == now.threshold_epsilon == 0.2
    assert (earlier.threshold_boldness, earlier.threshold_noise) == ((1.0, 1.0, 3.0), 0.4)
    assert (earlier.threshold_covering, earlier.threshold_design) == (0, "farthest")
    assert now == Settings(threshold_epsilon=0.2)
