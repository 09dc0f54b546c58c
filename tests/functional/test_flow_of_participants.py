"""Who arrived, declined and is counted: the same numbers on the overview and in the report."""

from __future__ import annotations

import pytest

from app.services import reporting
from app.services.accounts import accounts
from app.services.context import AppContext
from app.services.export.table import Request
from app.services.monitoring.overview import overview
from app.services.reporting.document import Paragraph, Table
from app.services.sessions import withdrawal
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import Clock

from .client import Api, by_turns
from .conftest import EMAIL, PASSWORD
from .test_checks import table as exported
from .test_experimenter_pages import sign_in
from .test_watching import table

CAPTION = "Sessions, from arriving to being counted"


def report_of(
    app: AppContext, *conditions: str, modes: tuple[str, ...] = ("live",)
) -> tuple[dict[str, int], str]:
    """The flow, and all that the report says in sentences."""
    request = Request(repository.find(app, "short"), modes, conditions)
    report = reporting.describe(app, request)
    (flow,) = (b for b in report.blocks if isinstance(b, Table) and b.caption == CAPTION)
    said = " ".join(block.text for block in report.blocks if isinstance(block, Paragraph))
    return {name: int(number) for name, number in flow.rows}, said


@pytest.fixture
def mixed(client: Api, learning_study: StudyInfo, clock: Clock) -> Api:
    """One completed, one withdrew after an answer, one only consented, one declined by a program,
    and two on the page, one of them on another day."""
    client.start().to_the_end(by_turns("left", "skip", "right"), clock.forward)
    left = client.start().to_first_query()
    left.respond("left")
    left.call("withdraw")
    client.start().consent()
    client.start().call("withdraw")
    for _ in range(2):
        answer = client.post("/s/short/decline")
        assert answer.status_code == 200
        assert "set-cookie" not in answer.headers
        clock.forward(24 * 3600)
    return client


def test_the_report_rests_on_sessions_with_answers(mixed: Api, app: AppContext) -> None:
    flow, said = report_of(app)
    assert flow["Counted in this report"] == 2
    assert flow["Without an answer that counts"] == 2
    assert "What follows rests on 2 sessions of 2 participants with 16 answers" in said
    assert "of 2 sessions with answers have no flag" in said


def test_who_declines_on_the_page_is_a_number_and_nothing_else(mixed: Api, app: AppContext) -> None:
    flow, _ = report_of(app)
    assert flow["Declined to consent"] == 3
    assert flow["Arrived"] == 6
    assert report_of(app, modes=("simulated",))[0]["Declined to consent"] == 0
    with app.database.read() as db:
        rows = db.connection().exec_driver_sql(
            "SELECT day, number FROM declined_counts ORDER BY day"
        )
        assert [number for _, number in rows] == [1, 1]


def test_overview_and_report_agree_before_and_after_a_deletion(
    mixed: Api, app: AppContext, learning_study: StudyInfo, clock: Clock
) -> None:
    accounts.create(app, EMAIL, PASSWORD)
    assert sign_in(mixed).status_code == 303
    gone = mixed.start().to_first_query()
    for number in (7, 7):
        flow, _ = report_of(app)
        shown = table(mixed.get("/studies/short"), "funnel").set_index("Step")
        reached = dict(shown["Reached"].astype(int))
        assert flow["Arrived"] == reached["Arrived"] == number
        assert flow["Consented"] == reached["Consented"]
        counts = overview(app, learning_study, "live").counts
        assert flow["Declined to consent"] == counts["declined"] == 3
        assert flow["Deleted at their person's wish"] == counts["deleted"]
        if not counts["deleted"]:
            withdrawal.withdraw_and_delete(app, gone.token)
    assert flow["Deleted at their person's wish"] == 1


def test_declining_where_a_study_is_closed_or_unknown_counts_nothing(
    client: Api, app: AppContext, learning_study: StudyInfo
) -> None:
    repository.close_study(app, "short")
    client.post("/s/short/decline")
    assert client.post("/s/nonsense/decline").status_code == 404
    assert report_of(app)[0]["Declined to consent"] == 0


@pytest.mark.parametrize("condition", ["pbpo", "no-skip"])
def test_a_report_of_one_condition_counts_its_answers_alone(
    mixed: Api, app: AppContext, condition: str
) -> None:
    queries = exported(app, "queries").query("condition == @condition")
    answers = queries["response"].dropna()
    sessions = queries["session_id"].nunique()
    flow, said = report_of(app, condition)
    assert flow["Counted in this report"] == sessions
    noun = "session of 1 participant" if sessions == 1 else "sessions of 2 participants"
    skips = (answers == "skip").sum()
    are = "is a skip" if skips == 1 else "are skips"
    assert f"rests on {sessions} {noun} with {len(answers)} answers" in said
    assert f"of which {skips} {are}." in said
    assert f"Only trials under {condition} are counted." in said
    assert "A flag is of a whole session" in said
    assert "Only trials under" not in report_of(app)[1]
