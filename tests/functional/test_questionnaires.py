"""Questionnaires through the API and as pages: taken whole or not at all, and exported."""

from __future__ import annotations

import csv
import re

import pytest

from app.services.context import AppContext
from app.services.export import Request
from app.services.results.questionnaires import summaries
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.web.http import translations
from app.web.http.security import session_cookie
from app.web.http.translations import Wording
from tests.conftest import SHORT_PLAN, Clock, StudyShelf

from .client import Api, Session

ASKING_PLAN = (
    SHORT_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 1")
    + """
questionnaires:
  after_trial:
    - {name: effort, type: likert, points: 7, label: "How hard was it?", labels: [Easy, Hard]}
  end:
    - {name: age, type: number, min: 18, max: 120, label: "How old are you?"}
    - {name: remarks, type: text, label: "Anything else?", required: false}
"""
)


@pytest.fixture
def asking_study(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    study_shelf.put_into(app, ASKING_PLAN)
    return repository.find(app, "short")


def to_the_questions(client: Api) -> Session:
    session = client.start().to_first_query()
    session.respond("left")
    assert session.state["stage"] == "questionnaire"
    return session


def test_answers_lead_on_and_come_out_in_an_export(
    client: Api, asking_study: StudyInfo, clock: Clock, api_token: str, app: AppContext
) -> None:
    session = to_the_questions(client)
    for trial in (1, 2, 3):
        assert session.state["progress"]["trial"] == trial
        assert session.state["questionnaire"]["page"] == "trial"
        session.call("questionnaire", {"answers": {"effort": trial}})
        if trial < 3:
            assert session.state["stage"] == "break"
            clock.forward(120)
            session.go_on()
            session.respond("left")
    assert session.state["questionnaire"]["page"] == "end"
    assert [item["name"] for item in session.state["questionnaire"]["items"]] == ["age", "remarks"]
    session.call("questionnaire", {"answers": {"age": 40, "remarks": "=1+1"}})
    assert session.state["stage"] == "debrief"

    with app.database.read() as db:
        effort, age, remarks = summaries(db, Request(repository.find(app, "short")))
    assert effort.caption == "effort: How hard was it?"
    assert sorted(row[1:4] for row in effort.rows) == [
        ("1", "1", ""),
        ("1", "2", ""),
        ("1", "3", ""),
    ]
    assert age.rows == [("at the end", "1", "40", "", "40", "40 to 40", "40 to 40")]
    assert remarks.rows == [("at the end", "1")]

    page = client.get(
        "/studies/short/results", headers={"Authorization": f"Bearer {api_token}"}
    ).text
    assert "effort: How hard was it?" in page

    rows = client.table("questionnaires", api_token)
    found = rows[["trial_index", "item", "type", "value"]].to_numpy().tolist()
    assert [[trial, item, kind, str(value)] for trial, item, kind, value in found] == [
        [0, "effort", "likert", "1"],
        [1, "effort", "likert", "2"],
        [2, "effort", "likert", "3"],
        [-1, "age", "number", "40"],
        [-1, "remarks", "text", "'=1+1"],
    ]


def test_one_of_several_answers_is_chosen_on_the_page(
    client: Api, app: AppContext, study_shelf: StudyShelf, request: pytest.FixtureRequest
) -> None:
    effort = (
        '{name: effort, type: likert, points: 7, label: "How hard was it?", labels: [Easy, Hard]}'
    )
    hand = '{name: hand, type: choice, label: "Which hand?", choices: {left: <Left>, both: Both}}'
    study_shelf.put_into(app, ASKING_PLAN.replace(effort, hand))
    api_token = request.getfixturevalue("api_token")
    session = to_the_questions(client)
    client.cookies.set(session_cookie("short"), session.token)
    assert "&lt;Left&gt;" in client.get("/s/short").text
    refused = client.post("/s/short/questionnaire", data={"hand": "right"})
    assert "Please choose one of these." in refused.text
    assert client.post("/s/short/questionnaire", data={"hand": "both"}).status_code == 303
    (row,) = client.table("questionnaires", api_token).to_dict("records")
    assert (row["type"], row["value"]) == ("choice", "both")


def test_answers_that_cannot_be_taken_are_all_named_and_none_is_kept(
    client: Api, asking_study: StudyInfo, api_token: str
) -> None:
    session = to_the_questions(client)
    refusal = session.call("questionnaire", {"answers": {"effort": 9, "mood": "good"}})
    assert refusal.status_code == 422
    problem = refusal.json()
    assert problem["type"] == "urn:pbpo-studio:problem:answers-refused"
    assert problem["stage"] == "questionnaire"
    assert {(fault["item"], fault["kind"]) for fault in problem["faults"]} == {
        ("effort", "likert"),
        ("mood", "unknown"),
    }
    assert session.look()["stage"] == "questionnaire"
    assert client.table("questionnaires", api_token).empty


def test_questions_cannot_be_passed_over_nor_answered_elsewhere(
    client: Api, asking_study: StudyInfo
) -> None:
    session = client.start()
    early = session.call("questionnaire", {"answers": {"effort": 1}})
    assert (early.status_code, early.json()["stage"]) == (409, "consent")
    session.to_first_query().respond("left")
    over = session.go_on()
    assert (over.status_code, over.json()["stage"]) == (409, "questionnaire")


def test_the_page_keeps_what_was_given_and_says_what_is_wrong(
    client: Api, asking_study: StudyInfo, clock: Clock
) -> None:
    session = to_the_questions(client)
    client.cookies.set("pbpo_session_short", session.token)
    page = client.get("/s/short").text
    assert len(re.findall(r'type="radio" name="effort"', page)) == 7
    assert 'role="alert"' not in page

    assert client.post("/s/short/questionnaire", data={"effort": "5"}).status_code == 303
    clock.forward(120)
    while session.look()["stage"] != "questionnaire" or "'age'" not in str(session.state):
        session.step("left", clock.forward)
    asked = client.get("/s/short").text
    assert "A number from 18 to 120" in asked
    assert "<title>Some questions" in asked
    refused = client.post("/s/short/questionnaire", data={"age": "12", "remarks": "<b>hm</b>"})
    assert refused.status_code == 422
    assert "<title>Error: Some questions" in refused.text
    assert refused.text.count("Please give a number from 18 to 120.") == 2
    assert 'href="#answer-age"' in refused.text
    assert 'value="12"' in refused.text
    assert "&lt;b&gt;hm&lt;/b&gt;" in refused.text
    assert client.post("/s/short/questionnaire", data={"age": "20"}).status_code == 303
    assert session.look()["stage"] == "debrief"


NUMBER_PLAN = (
    SHORT_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 1")
    + """
questionnaires:
  after_trial:
    - {name: income, type: number, label: "What do you earn?"}
    - {name: hours, type: number, max: 24, label: "How long did you sleep?"}
    - {name: mood, type: likert, points: 5, label: "How are you?"}
"""
)


@pytest.fixture
def numbers_page(app: AppContext, study_shelf: StudyShelf, client: Api) -> Session:
    """A session at the questions, in the browser."""
    study_shelf.put_into(app, NUMBER_PLAN)
    session = to_the_questions(client)
    client.cookies.set("pbpo_session_short", session.token)
    return session


def stored(client: Api, api_token: str) -> dict[str, str]:
    headers = {"Authorization": f"Bearer {api_token}"}
    answer = client.get("/api/v1/studies/short/export/questionnaires.csv", headers=headers)
    return {row["item"]: row["value"] for row in csv.DictReader(answer.text.splitlines())}


@pytest.mark.parametrize(("meant", "kept"), [("50000", "50000"), ("50", "50")])
def test_a_number_that_could_be_two_is_asked_back_and_stored_as_was_meant(
    client: Api, numbers_page: Session, api_token: str, meant: str, kept: str
) -> None:
    sent = {"income": "50,000", "hours": "7,5", "mood": "3"}
    asked = client.post("/s/short/questionnaire", data=sent)
    assert asked.status_code == 422
    assert "Which number do you mean?" in asked.text
    assert re.findall(r'name="income.meant" value="([^"]+)"', asked.text) == ["50000", "50"]
    assert 'value="50,000"' in asked.text
    assert client.table("questionnaires", api_token).empty

    # The same again is asked again; so is a number that the text does not say.
    assert client.post("/s/short/questionnaire", data=sent).status_code == 422
    forged = {**sent, "income.meant": "7"}
    assert client.post("/s/short/questionnaire", data=forged).status_code == 422
    # What was chosen stays chosen while something else is missing.
    unfinished = {**sent, "mood": "", "income.meant": meant}
    page = client.post("/s/short/questionnaire", data=unfinished)
    assert page.status_code == 422
    assert re.findall(r'type="hidden" name="income.meant" value="([^"]+)"', page.text) == [meant]

    done = client.post("/s/short/questionnaire", data={**sent, "income.meant": meant})
    assert done.status_code == 303
    assert stored(client, api_token) == {"income": kept, "hours": "7.5", "mood": "3"}


def test_only_what_an_item_takes_is_offered_and_nothing_is_taken_unasked(
    client: Api, numbers_page: Session, api_token: str
) -> None:
    sent = {"income": "1", "hours": "1,000", "mood": "3"}
    asked = client.post("/s/short/questionnaire", data=sent)
    assert re.findall(r'name="hours.meant" value="([^"]+)"', asked.text) == ["1"]
    out_of_range = client.post("/s/short/questionnaire", data={**sent, "hours": "50,000,000"})
    assert "Please give a number of at most 24." in out_of_range.text
    assert client.table("questionnaires", api_token).empty


def test_the_api_asks_back_what_a_text_may_mean_and_takes_a_json_number(
    client: Api, numbers_page: Session, api_token: str
) -> None:
    answers = {"income": "50,000", "hours": 7.5, "mood": 3}
    refused = numbers_page.call("questionnaire", {"answers": answers})
    assert refused.status_code == 422
    (fault,) = refused.json()["faults"]
    assert (fault["item"], fault["kind"]) == ("income", "doubtful")
    assert fault["readings"] == ["50000", "50"]
    assert "is 50000 or 50 meant?" in fault["message"]
    assert client.table("questionnaires", api_token).empty
    sure = {**answers, "income": 50_000}
    assert numbers_page.call("questionnaire", {"answers": sure}).status_code == 200
    assert stored(client, api_token)["income"] == "50000"


def test_japanese_readers_are_asked_in_japanese() -> None:
    asked = (
        "This can be read in more than one way, or has marks between its digits."
        " Which number do you mean?"
    )
    assert "どの数" in translations.translations(Wording("ja")).gettext(asked)
    assert translations.exact_number("50000", Wording("ja")) == "50000"
    assert translations.exact_number("1.25", Wording("ja")) == "1.25"
