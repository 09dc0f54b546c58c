"""Why a pair was skipped, where a study asks for it; and what is said only if it is asked for."""

from __future__ import annotations

from typing import Any

import pytest
from sqlalchemy import select

from app.pbbo import PreferenceOptimizer, Settings
from app.services.context import AppContext
from app.services.sessions import replay
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import Acquired, Trial
from app.web.http.security import session_cookie
from tests.conftest import SHORT_PLAN, StudyShelf

from .client import Api, Session

ASKING_PLAN = SHORT_PLAN.replace(
    "    skip: {label: {en: I don't like either.}}",
    "    skip:\n      label: {en: I don't like either.}\n"
    "      reasons: {both_bad: {en: Both are bad}, cannot_tell: I cannot tell}",
).replace(
    "break_s: 120",
    "break_s: 0\norder: fixed\nquery: {watch_once: true,"
    " question: {en: 'Which looks safer?'}, left: The <left>, right: The right}",
)


@pytest.fixture
def asking(app: AppContext, study_shelf: StudyShelf, client: Api) -> Session:
    study_shelf.put_into(app, ASKING_PLAN)
    return client.start().to_first_query()


def test_the_page_is_told_the_reasons(asking: Session) -> None:
    skip = asking.state["query"]["skip"]
    assert skip["label"] == "I don't like either."
    assert {reason["name"]: reason["label"] for reason in skip["reasons"]} == {
        "both_bad": "Both are bad",
        "cannot_tell": "I cannot tell",
    }
    assert asking.state["query"]["watch_once"] is True


def test_the_question_and_the_words_of_the_answers_are_the_studys(
    asking: Session, client: Api
) -> None:
    words = {"question": "Which looks safer?", "left": "The <left>", "right": "The right"}
    assert asking.state["study"]["words"] == words
    client.cookies.set(session_cookie("short"), asking.token)
    page = client.get("/s/short").text
    assert ">Which looks safer?</h1>" in page
    assert "The &lt;left&gt;" in page
    assert "Which video is better?" not in page


def test_the_order_of_the_reasons_is_drawn_for_each_session_kept_and_exported(
    asking: Session, client: Api, api_token: str
) -> None:
    def listed(session: Session) -> str:
        return "; ".join(one["name"] for one in session.state["query"]["skip"]["reasons"])

    sessions = [asking, *(client.start().to_first_query() for _ in range(11))]
    orders = [listed(session) for session in sessions]
    assert set(orders) == {"both_bad; cannot_tell", "cannot_tell; both_bad"}
    for session, order in zip(sessions[:3], orders, strict=False):
        session.respond("skip")
        session.look()
        assert listed(session) == order
    assert client.table("sessions", api_token)["skip_reason_order"].to_list() == orders


def test_what_a_study_does_not_ask_for_is_not_in_its_queries(
    client: Api, short_study: StudyInfo
) -> None:
    query = client.start().to_first_query().state["query"]
    assert "words" not in client.start().state["study"]
    assert set(query) == {"id", "left", "right", "skip", "prefetch"}
    assert query["skip"] is None or set(query["skip"]) == {"label"}


def test_reasons_are_kept_apart_in_the_data(asking: Session, app: AppContext) -> None:
    assert asking.respond("skip", skip_reason="cannot_tell").status_code == 200
    assert asking.respond("skip", skip_reason="both_bad").status_code == 200
    assert asking.respond("skip").status_code == 200
    assert asking.respond("left").status_code == 200
    from app.services.export import TABLES, Request, csv_stream
    from app.services.studies.repository import find

    table = b"".join(csv_stream(app, TABLES["queries"], Request(find(app, "short"))))
    lines = [line.split(",") for line in table.decode().splitlines()]
    column = lines[0].index("skip_reason")
    assert [line[column] for line in lines[1:5]] == ["cannot_tell", "both_bad", "", ""]


@pytest.mark.parametrize(
    ("response", "reason", "detail"),
    [
        ("skip", "tired", "expected one of both_bad, cannot_tell, got 'tired'"),
        ("left", "both_bad", "expected a reason with a skip only, got one with 'left'"),
    ],
)
def test_a_reason_that_is_not_offered_is_refused(
    asking: Session, response: str, reason: str, detail: str
) -> None:
    refusal = asking.respond(response, skip_reason=reason)
    assert refusal.status_code == 422
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:skip-reason"
    assert refusal.json()["detail"] == detail
    assert asking.look()["progress"]["query"] == 1


def test_the_model_learns_from_the_reason_of_a_skip(
    app: AppContext, study_shelf: StudyShelf, client: Api
) -> None:
    study_shelf.put_into(
        app,
        ASKING_PLAN.replace("    method: pbpo\n", "    method: pbpo-threshold\n").replace(
            "settings: {preset: paper-env1}", "settings: {}", 1
        ),
    )
    session = client.start().to_first_query()
    for response, reason in (("left", None), ("skip", "cannot_tell"), ("skip", "both_bad")):
        more = {} if reason is None else {"skip_reason": reason}
        assert session.respond(response, **more).status_code == 200

    with app.database.read() as database:
        trial = database.scalars(select(Trial)).one()
        told: list[Any] = []
        for query in trial.queries:
            if query.response is not None:
                reason = query.response.skip_reason
                answer = (query.left_candidate, query.right_candidate, query.response.response)
                told.append((*answer, reason) if reason else answer)
        last = database.scalars(select(Acquired).order_by(Acquired.query_index.desc())).first()
        assert last is not None
        stored = (last.candidate, last.posterior_mean)
        points = app.proposer.candidate_set(trial.session.study_id, "env1").candidates
        seed = trial.seed
    assert [len(answer) for answer in told] == [3, 4, 4]
    with_reasons = PreferenceOptimizer.replay(points, told, method="pbpo-threshold", seed=seed)
    without = PreferenceOptimizer.replay(
        points, [answer[:3] for answer in told], method="pbpo-threshold", seed=seed
    )
    mean = float(with_reasons.posterior()[0][with_reasons.best()])
    assert stored[0] == with_reasons.best()
    assert stored[1] == pytest.approx(mean)
    assert stored[1] != pytest.approx(float(without.posterior()[0][stored[0]]))
    [replayed] = list(replay.replay(app, "short"))
    assert replayed.differences == ()


def test_a_skip_without_a_reason_means_what_the_plan_says(
    app: AppContext, study_shelf: StudyShelf, client: Api
) -> None:
    label = "skip: {label: {en: I don't like either.}"
    plan = SHORT_PLAN.replace("    method: pbpo\n", "    method: pbpo-threshold\n").replace(
        "settings: {preset: paper-env1}", "settings: {}", 1
    )
    plan = plan.replace("break_s: 120", "break_s: 0\norder: fixed")
    assert label in plan
    study_shelf.put_into(app, plan.replace(label, label + ", means: cannot_tell", 1))
    session = client.start().to_first_query()
    for response in ("left", "skip", "right"):
        assert session.respond(response).status_code == 200

    with app.database.read() as database:
        trial = database.scalars(select(Trial)).one()
        told = [
            (query.left_candidate, query.right_candidate, query.response.response)
            for query in trial.queries
            if query.response is not None
        ]
        last = database.scalars(select(Acquired).order_by(Acquired.query_index.desc())).first()
        assert last is not None
        points = app.proposer.candidate_set(trial.session.study_id, "env1").candidates
    means = {
        meaning: PreferenceOptimizer.replay(
            points,
            told,
            method="pbpo-threshold",
            seed=trial.seed,
            settings=Settings(threshold_skip_means=meaning),
        ).posterior()[0][last.candidate]
        for meaning in ("cannot_tell", "both_bad")
    }
    assert last.posterior_mean == pytest.approx(means["cannot_tell"])
    assert last.posterior_mean != pytest.approx(means["both_bad"])
