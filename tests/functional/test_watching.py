"""Watching a study: its page, the part that changes, the stream, one session, the results."""

from __future__ import annotations

import asyncio
import io
import re
from collections.abc import Iterator
from datetime import datetime
from typing import Any

import httpx
import pandas as pd
import pytest
from fastapi import FastAPI

from app.services.accounts import accounts
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.monitoring import data_quality
from app.services.monitoring.change_token import change_token
from app.services.monitoring.data_quality import Evidence, Flag, flags_of
from app.services.results.registry import FINDINGS
from app.services.studies.repository import StudyInfo
from app.web.http.server_sent_events import LOOKS_BETWEEN_SIGNS_OF_LIFE, changes
from tests.conftest import SHORT_PLAN, Clock, StudyShelf
from tests.databases import Databases

from .client import Api, by_turns
from .test_experimenter_pages import sign_in

WATCHED_PLAN = (
    SHORT_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 5").replace(
        "settings: {preset: paper-env1}", "settings: {preset: paper-env1, random_queries: 2}"
    )
    + "checks: {repeats: 0.2}\nreward: {amount: 6, currency: EUR}\n"
)
MEMBER = "bob@lab.example"


#: What the study's database holds, once it is made: two minutes of tests else.
_MADE: list[tuple[Any, datetime]] = []


@pytest.fixture
def watched(
    client: Api,
    app: AppContext,
    study_shelf: StudyShelf,
    clock: Clock,
    databases: Databases,
) -> Api:
    """A study that two have completed, one has left, one is in, and one declined."""
    if _MADE:
        kept, clock.time = _MADE[0]
        databases.put_into(app.settings.url, kept)
    else:
        study_shelf.put_into(app, WATCHED_PLAN)
        accounts.create(app, "ada@lab.example", "correct horse battery")
        for _ in range(2):
            client.start().to_the_end(by_turns("left", "right", "skip", "left"), clock.forward)
        client.start().to_first_query().call("withdraw")
        client.start().call("withdraw")
        client.start().to_first_query().respond("left", rt_ms=900.0)
        _MADE.append((databases.keep(app.settings.url), clock.time))
    assert sign_in(client).status_code == 303
    return client


def table(page: httpx.Response, testid: str) -> pd.DataFrame:
    found = re.search(rf'<table[^>]*data-testid="{testid}".*?</table>', page.text, re.DOTALL)
    assert found, page.text
    rows = re.findall(r"<tr.*?</tr>", found[0], re.DOTALL)
    cells = [
        [
            re.sub(r"<[^>]+>", "", cell).strip()
            for cell in re.findall(r"<t[dh].*?</t[dh]>", row, re.DOTALL)
        ]
        for row in rows
    ]
    wide = [row + [""] * (len(cells[0]) - len(row)) for row in cells[1:]]
    return pd.DataFrame(wide, columns=cells[0])


def exported(client: Api, name: str) -> pd.DataFrame:
    answer = client.get(f"/api/v1/studies/short/export/{name}.csv")
    assert answer.status_code == 200
    return pd.read_csv(io.BytesIO(answer.content))


def test_the_funnel_counts_who_came_how_far_and_where_they_were_lost(watched: Api) -> None:
    shown = table(watched.get("/studies/short"), "funnel").set_index("Step")
    assert dict(shown["Reached"].astype(int)) == {
        "Arrived": 5,
        "Consented": 4,
        "Began the queries": 4,
        "Completed": 2,
    }
    assert list(shown.loc["Arrived", ["Still here", "Away", "Left"]]) == ["0", "0", "1"]
    assert list(shown.loc["Began the queries", ["Still here", "Away", "Left"]]) == ["1", "0", "1"]
    sessions = exported(watched, "sessions")
    assert len(sessions) == 5
    assert sessions["consented_at"].notna().sum() == 4
    assert (sessions["stage"] == "completed").sum() == 2


def test_who_is_not_heard_of_for_the_lease_is_away(watched: Api, clock: Clock) -> None:
    clock.forward(61 * 60)
    shown = table(watched.get("/studies/short"), "funnel").set_index("Step")
    assert list(shown.loc["Began the queries", ["Still here", "Away", "Left"]]) == ["0", "1", "1"]


def test_the_trials_per_condition_are_those_of_the_export(watched: Api) -> None:
    shown = table(watched.get("/studies/short"), "conditions").set_index("Condition")
    assert shown["Completed"].astype(int).sum() == 6
    assert shown["Active"].astype(int).sum() == 1
    queries = exported(watched, "queries")
    done = queries.groupby(["session_id", "trial_index", "condition"])["response"].count()
    finished = done[done == 6].reset_index().groupby("condition").size()
    assert dict(shown["Completed"].astype(int)) == finished.to_dict()


def test_the_median_time_gives_the_pay_per_hour(watched: Api) -> None:
    page = watched.get("/studies/short")
    sessions = exported(watched, "sessions").query("stage == 'completed'")
    minutes = (
        pd.to_datetime(sessions["ended_at"]) - pd.to_datetime(sessions["started_at"])
    ).median() / pd.Timedelta(minutes=1)
    assert f">{round(minutes, 1):g}<small> min" in page.text
    assert f">{6 * 60 / minutes:.2f}<small> EUR" in page.text


def test_a_condition_that_is_switched_off_says_so(watched: Api, app: AppContext) -> None:
    from app.storage.models.studies import Study

    with app.database.write() as db:
        study = db.query(Study).one()
        study.conditions_off = ["no-skip"]
    shown = table(watched.get("/studies/short"), "conditions")
    assert [name for name in shown["Condition"] if name.endswith("Off")] == ["no-skip Off"]


def test_the_part_that_changes_is_the_part_of_the_page(watched: Api) -> None:
    page, part = watched.get("/studies/short").text, watched.get("/studies/short/live").text
    assert part.strip() in page
    assert part.lstrip().startswith('<div id="watching" data-stamp="')


def test_an_answer_changes_the_stamp_and_nothing_leaves_it_as_it_is(
    client: Api, app: AppContext, short_study: StudyInfo, clock: Clock, api_token: str
) -> None:
    def now() -> str:
        return change_token(app, short_study.id, ("live",), short_study.plan.lease_minutes)

    seen = [now()]
    session = client.start()
    seen.append(now())
    session.to_first_query()
    seen.append(now())
    session.respond("left")
    seen.append(now())
    assert len(set(seen)) == len(seen)
    assert now() == seen[-1]
    client.start(mode="preview", by=api_token)
    assert now() == seen[-1]
    clock.forward(61 * 60)
    assert now() != seen[-1]


def stream(stamps: Iterator[str], known: str | None, looks: int) -> list[str]:
    """What a stream of so many looks says."""
    left = iter(range(looks))

    async def collect() -> list[str]:
        async def at_once(_seconds: float) -> None:
            return None

        def stopping() -> bool:
            return next(left, None) is None

        events = changes(lambda: next(stamps), known, stopping, at_once)
        return [event async for event in events]

    return asyncio.run(collect())


def test_the_stream_tells_of_each_change_once_and_ends_when_the_server_stops() -> None:
    said = stream(iter("aabbb"), "a", 5)
    assert said[0].startswith("retry: ")
    assert [event for event in said if "changed" in event] == ["id: b\nevent: changed\ndata: b\n\n"]


def test_the_stream_shows_a_sign_of_life_while_nothing_happens() -> None:
    looks = 2 * LOOKS_BETWEEN_SIGNS_OF_LIFE + 1
    said = stream(iter("a" * looks), "a", looks)
    assert sum(event.startswith(":") for event in said) == 3


def test_the_stream_is_one_of_events_that_nobody_keeps(
    watched: Api, application: FastAPI, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = iter([False])
    application.state.stopping = lambda: next(looks, True)
    monkeypatch.setattr("app.web.http.server_sent_events.SECONDS_BETWEEN_LOOKS", 0.0)
    answer = watched.get("/studies/short/events", headers={"Last-Event-ID": "before"})
    assert answer.headers["content-type"].startswith("text/event-stream")
    assert answer.headers["cache-control"] == "no-store"
    known = re.search(r"id: ([0-9a-f]{16})\nevent: changed", answer.text)
    assert known
    assert f'data-stamp="{known[1]}"' in watched.get("/studies/short").text


def test_a_session_is_told_query_by_query(watched: Api) -> None:
    sessions, queries = exported(watched, "sessions"), exported(watched, "queries")
    done = sessions.query("stage == 'completed'")["session_id"].iloc[0]
    page = watched.get(f"/studies/short/sessions/{done}")
    assert page.status_code == 200, page.text
    assert page.text.count('data-testid="trial"') == 3
    of_session = queries[queries["session_id"] == done]
    assert page.text.count('class="story-head"') == len(of_session) == 18
    skips = (of_session["response"] == "skip").sum()
    assert page.text.count("<b>Skip</b>") == skips > 0
    preferences = exported(watched, "preferences").query("session_id == @done")
    assert page.text.count("(synthesised)") == (preferences["origin"] == "synthesis").sum()
    first = of_session.iloc[0]
    assert f"left of query 1, candidate {first['left_candidate']}" in page.text


def test_how_the_acquired_candidate_moved_is_what_is_exported(watched: Api) -> None:
    acquired = exported(watched, "acquired")
    done = acquired["session_id"].iloc[0]
    answer = watched.get(f"/studies/short/sessions/{done}/figures/0/path.csv")
    path = pd.read_csv(io.BytesIO(answer.content))
    expected = acquired.query("session_id == @done and trial_index == 0").reset_index()
    for column in ("query_index", "candidate", "w0", "w1"):
        assert list(path[column]) == list(expected[column])


def test_the_models_belief_is_worked_out_again_from_the_answers(watched: Api) -> None:
    acquired = exported(watched, "acquired").dropna(subset="posterior_mean")
    last = acquired.iloc[-1]
    where = f"/studies/short/sessions/{last['session_id']}/figures/{last['trial_index']}/posterior"
    belief = pd.read_csv(io.BytesIO(watched.get(f"{where}.csv").content)).set_index("candidate")
    assert len(belief) == 231
    there = belief.loc[last["candidate"]]
    assert there["posterior_mean"] == pytest.approx(last["posterior_mean"])
    assert there["posterior_std"] == pytest.approx(last["posterior_std"])
    assert belief["posterior_mean"].max() == pytest.approx(last["posterior_mean"])
    answered = exported(watched, "queries").query(
        "session_id == @last.session_id and trial_index == @last.trial_index"
    )
    assert belief["times_shown"].sum() == 2 * answered["response"].notna().sum()


@pytest.mark.parametrize("name", FINDINGS)
def test_every_figure_is_a_chart_a_picture_and_its_table(watched: Api, name: str) -> None:
    where = f"/studies/short/figures/{name}"
    told = watched.get(f"{where}.json").json()
    assert told["rows"] > 0, told["says"]
    assert told["chart"]["$schema"].startswith("https://vega.github.io/schema/vega-lite/v6")
    table = pd.read_csv(io.BytesIO(watched.get(f"{where}.csv").content))
    assert len(table) == told["rows"]
    svg = watched.get(f"{where}.svg")
    assert svg.headers["content-disposition"] == f'attachment; filename="short-{name}.svg"'
    assert svg.text.startswith("<svg")
    dark = watched.get(f"{where}.json", params={"theme": "dark"}).text
    assert "#1c1f24" not in dark


def test_a_figure_is_saved_as_png(watched: Api) -> None:
    png = watched.get("/studies/short/figures/repeats.png")
    assert png.content.startswith(b"\x89PNG")
    assert png.headers["content-type"] == "image/png"


def test_the_numbers_of_the_figures_are_those_of_the_export(watched: Api) -> None:
    def found(name: str) -> pd.DataFrame:
        return pd.read_csv(io.BytesIO(watched.get(f"/studies/short/figures/{name}.csv").content))

    queries = exported(watched, "queries").dropna(subset="response")
    sides = found("sides").set_index("session_id")
    choices = queries[queries["response"] != "skip"]
    asked = choices[choices["trial_type"].isin(["random", "model"])]
    left = (asked["response"] == "left").groupby(asked["session_id"]).mean()
    assert dict(sides["share_left"].round(9)) == dict(left.round(9))

    times = found("response-times")
    assert times["rt_ms"].median() == queries["rt"].median()

    checks = exported(watched, "checks").dropna(subset="passed")
    repeats = found("repeats")
    assert repeats["agreed"].sum() == checks["passed"].astype(bool).sum()
    assert repeats["repeats"].sum() == len(checks)

    rates = found("win-rates").set_index("candidate")
    real = choices[choices["trial_type"].isin(["random", "model"])]
    for candidate, row in rates.iterrows():
        shown = (real["left_candidate"] == candidate) | (real["right_candidate"] == candidate)
        assert row["comparisons"] == shown.sum()
        assert row["wins"] == (real["chosen_candidate"] == candidate).sum()

    skips = found("skips")
    offered = queries[queries["condition"].isin(["pbpo", "no-synthesis"])]
    offered = offered[offered["trial_type"].isin(["random", "model"])]
    assert skips["skips"].sum() == (offered["response"] == "skip").sum()
    assert skips["answers"].sum() == len(offered)

    ends = found("acquired-on-w")
    last = exported(watched, "acquired").groupby(["session_id", "trial_index"]).last()
    assert len(ends) == 6
    for _, row in ends.iterrows():
        assert row["candidate"] == last.loc[(row["session_id"], row["trial_index"]), "candidate"]
    recordings = exported(watched, "recordings").groupby("candidate")["score"].mean()
    scores = found("acquired-scores")
    assert list(scores["score"]) == pytest.approx(
        [recordings.loc[candidate] for candidate in scores["candidate"]]
    )


def test_a_study_that_nobody_came_to_yet_says_so_and_draws_nothing(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    assert sign_in(client).status_code == 303
    assert client.get("/studies/short").status_code == 200
    assert client.get("/studies/short/results").status_code == 200
    for name in FINDINGS:
        told = client.get(f"/studies/short/figures/{name}.json").json()
        assert (told["rows"], told["chart"]) == (0, None)
        assert told["says"].endswith((".", ")."))
        assert client.get(f"/studies/short/figures/{name}.png").status_code == 404
        assert client.get(f"/studies/short/figures/{name}.csv").text == ""


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("figures/nonsense.json", 404),
        ("figures/sides.exe", 422),
        ("figures/sides.json?theme=blue", 422),
        ("sessions/nobody", 404),
        ("sessions/nobody/figures/0/path.json", 404),
        ("sessions/{session}/figures/7/path.json", 404),
        ("sessions/{session}/figures/-1/path.json", 404),
        ("sessions/{session}/figures/0/nonsense.json", 404),
        ("sessions/{session}/figures/first/path.json", 422),
    ],
)
def test_what_is_not_there_is_refused(watched: Api, path: str, status: int) -> None:
    session = exported(watched, "sessions")["session_id"].iloc[0]
    assert watched.get(f"/studies/short/{path.format(session=session)}").status_code == status


PAGES = (
    "",
    "/live",
    "/events",
    "/results",
    "/figures/sides.json",
    "/figures/sides.csv",
    "/sessions/{session}",
    "/sessions/{session}/figures/0/path.json",
)


@pytest.mark.parametrize("page", PAGES)
def test_who_may_not_see_the_data_sees_nothing_of_it(
    watched: Api, app: AppContext, page: str
) -> None:
    session = exported(watched, "sessions")["session_id"].iloc[0]
    path = f"/studies/short{page.format(session=session)}"
    accounts.create(app, MEMBER, "another good password", role=Role.EXPERIMENTER)
    watched.cookies.clear()
    assert watched.get(path).headers["location"].startswith("/sign-in")
    assert sign_in(watched, MEMBER, "another good password").status_code == 303
    assert watched.get(path).status_code == 404
    accounts.create(app, "rita@lab.example", "a third good password", role=Role.REVIEWER)
    watched.cookies.clear()
    assert sign_in(watched, "rita@lab.example", "a third good password").status_code == 303
    answer = watched.get(path)
    # The overview leads a reviewer to what they may see.
    assert (answer.status_code == 303) if page == "" else (answer.status_code == 403)


def test_a_session_of_another_study_is_not_found_in_this_one(
    watched: Api, app: AppContext, clock: Clock
) -> None:
    from app.storage.models.studies import SessionRow, Study

    with app.database.write() as db:
        other = Study(slug="other", status="draft", created_at=clock.now(), conditions_off=[])
        db.add(other)
        db.flush()
        row = db.query(SessionRow).first()
        assert row is not None
        row.study_id, name = other.id, row.public_id
    assert watched.get(f"/studies/short/sessions/{name}").status_code == 404


@pytest.mark.parametrize(
    ("evidence", "expected"),
    [
        (Evidence(), ()),
        (Evidence(answers=20, timed=20, fast=5, left=10, right=10), (Flag.FAST,)),
        (Evidence(answers=20, timed=20, fast=4, left=10, right=10), ()),
        (Evidence(answers=9, timed=9, fast=9, left=9), ()),
        (Evidence(answers=10, timed=10, left=9, right=1), (Flag.ONE_SIDED,)),
        (Evidence(answers=10, timed=10, left=2, right=8), ()),
        (Evidence(attention=4, attention_failed=2), (Flag.FAILED_CHECKS,)),
        (Evidence(attention=4, attention_failed=1), ()),
        (Evidence(repeats=4, repeats_failed=3), (Flag.FAILED_CHECKS,)),
        (Evidence(repeats=4, repeats_failed=2), ()),
        (Evidence(reported=20, unwatched=5), (Flag.UNWATCHED,)),
        (Evidence(reported=20, unwatched=4), ()),
        (Evidence(set_aside=1), (Flag.FAULTS,)),
    ],
)
def test_a_flag_is_raised_at_its_threshold_and_not_below(
    evidence: Evidence, expected: tuple[Flag, ...]
) -> None:
    assert flags_of(evidence) == expected


def test_flags_are_the_same_on_the_page_and_in_the_export(
    watched: Api, app: AppContext, clock: Clock
) -> None:
    session = watched.start()
    while session.state["stage"] != "completed":
        unwatched = [{"event": "watched", "side": "left", "time_ms": 5, "value": 0.1}]
        if session.state["stage"] == "query":
            session.respond("left", rt_ms=200.0, events=unwatched)
        else:
            session.step("left", clock.forward)
    sessions = exported(watched, "sessions").set_index("session_id")
    newest = sessions.index[-1]
    assert sessions["flags"].loc[newest] == "fast; one-sided; failed-checks; unwatched"
    shown = table(watched.get("/studies/short"), "sessions").set_index("Session")["Noticed"]
    labels = [data_quality.LABELS[Flag(name)] for name in sessions["flags"].loc[newest].split("; ")]
    assert shown.loc[newest] == " ".join(labels)
