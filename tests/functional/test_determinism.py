"""The same seed and the same responses give the same queries, in any process and at any time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest

from app.main import create_app
from app.pbbo import METHODS, allows_skip
from app.services.accounts import accounts
from app.services.background.interface import Background
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.runtime.settings import Settings
from app.study import plan_validation
from tests.conftest import Clock, Idle, NoRendering, StudyShelf
from tests.databases import Databases

from .client import Api, by_turns
from .conftest import EMAIL, LEARNING_PLAN, PASSWORD

PROPOSED = [
    *("trial_index", "condition", "query_index", "trial_type", "left_candidate"),
    *("right_candidate", "left_recording", "right_recording", "acquisition", "seed"),
]


@pytest.fixture
def places(databases: Databases, tmp_path: Path) -> Iterator[str]:
    """New databases."""
    return (databases.new(tmp_path / str(number)) for number in range(10))


def walked(
    database_url: str, media_dir: Path, shelf: StudyShelf, background: Background, seed: int
) -> dict[str, pd.DataFrame]:
    """The tables of a new studio in which one session of this seed went to the end."""
    clock = Clock()
    settings = Settings(data_dir=media_dir, media_dir=media_dir, database_url=database_url)
    app: AppContext = open_app(settings, now=clock.now, seed=lambda: seed, background=background)
    shelf.put_into(app, LEARNING_PLAN)
    token = accounts.create_api_token(app, accounts.create(app, EMAIL, PASSWORD), "tests")
    with Api(create_app(app=app)) as api:
        api.start().to_the_end(by_turns("left", "skip", "right"), clock.forward)
        names = ("queries", "preferences", "acquired")
        tables = {name: api.table(name, token) for name in names}
    app.close()
    return tables


def test_two_studios_ask_the_same_of_the_same_session(
    places: Iterator[str], media_dir: Path, study_shelf: StudyShelf
) -> None:
    # One of them works ahead, the other one works out each query when it is asked for.
    one = walked(next(places), media_dir, study_shelf, Idle(1), seed=7)
    two = walked(next(places), media_dir, study_shelf, NoRendering(1), seed=7)
    pd.testing.assert_frame_equal(one["queries"][PROPOSED], two["queries"][PROPOSED])
    for name in ("preferences", "acquired"):
        columns = [column for column in one[name].columns if column != "session_id"]
        pd.testing.assert_frame_equal(one[name][columns], two[name][columns], rtol=1e-12)

    other = walked(next(places), media_dir, study_shelf, Idle(1), seed=8)
    assert not one["queries"][PROPOSED].equals(other["queries"][PROPOSED])


def test_the_rules_of_a_study_know_the_methods_that_there_are() -> None:
    assert [method.name for method in plan_validation.METHODS] == list(METHODS)
    for method in plan_validation.METHODS:
        assert method.allows_skip == allows_skip(method.name), method.name


def test_recordings_are_drawn_among_all_of_a_candidate(
    client: Api, app: AppContext, study_shelf: StudyShelf, clock: Clock
) -> None:
    study_shelf.put_into(app, LEARNING_PLAN)
    token = accounts.create_api_token(app, accounts.create(app, EMAIL, PASSWORD), "tests")
    for _ in range(2):
        client.start().to_the_end(by_turns("left"), clock.forward)
    queries = client.table("queries", token)
    shown = pd.concat([queries["left_recording"], queries["right_recording"]])
    runs = shown.str.rsplit("-", n=1).str[1].astype(int)
    # 60 draws among five: each comes, and none more than half of the time.
    assert set(runs) == set(range(5))
    assert runs.value_counts().max() < 30
