"""An experimenter's tables: they hold exactly what was pressed, and name nobody."""

from __future__ import annotations

import codecs
import io
import zipfile
from dataclasses import dataclass, field
from typing import Any

import pandas as pd
import pytest

from app.services.accounts import accounts, audit_log
from app.services.context import AppContext
from app.services.studies.repository import StudyInfo
from tests.conftest import FROM_PROLIFIC, Clock, StudyShelf
from tests.databases import Databases

from .client import Api, Pressed, by_turns
from .conftest import EMAIL, LEARNING_PLAN, PASSWORD

PARAMETERS = ["w0", "w1"]
QUERIES = [
    *("study", "plan_hash", "participant_id", "session_id", "mode", "trial_index", "condition"),
    *("method", "environment", "query_index", "trial_type", "left_candidate", "right_candidate"),
    *("left_recording", "right_recording", "left_w0", "left_w1", "right_w0", "right_w1"),
    *("response", "chosen_candidate", "skip_reason", "rt", "shown_at", "answered_at"),
    *("acquisition", "seed", "engine_version", "consent_version"),
]
PREFERENCES = [
    *("session_id", "trial_index", "condition", "preference_index", "winner", "loser", "origin"),
    *("query_index", "drawn_from_query_index"),
]
ACQUIRED = [
    *("session_id", "trial_index", "condition", "query_index", "candidate", "w0", "w1"),
    *("posterior_mean", "posterior_std", "sureness"),
]
EVENTS = [
    "session_id",
    "trial_index",
    "condition",
    "query_index",
    "event",
    "side",
    "time_ms",
    "value",
]
IN_THE_ZIP = [
    *(
        "queries",
        "trials",
        "preferences",
        "acquired",
        "sessions",
        "consents",
        "participants",
        "questionnaires",
    ),
    *("deletions", "events", "evidence", "checks", "undone", "faults", "recordings"),
    *("rollouts", "people", "population", "data_dictionary"),
]
EXPORT = "/api/v1/studies/short/export.zip"
PLATFORM_ID = "5f0c1ada-prolific"


@dataclass(frozen=True)
class Walked:
    """A study in which one evaluator has gone the whole way."""

    client: Api
    api_token: str
    pressed: list[Pressed]

    def table(self, name: str, *modes: str) -> pd.DataFrame:
        return self.client.table(name, self.api_token, *modes)

    def get(self, path: str) -> bytes:
        headers = {"Authorization": f"Bearer {self.api_token}"}
        response = self.client.get(f"/api/v1/studies/short/{path}", headers=headers)
        assert response.status_code == 200, response.text
        return response.content


@dataclass
class Kept:
    """The walk, made by the first test that needs it: the others find what it stored."""

    rows: Any = None
    api_token: str = ""
    pressed: list[Pressed] = field(default_factory=list)


@pytest.fixture(scope="module")
def kept() -> Kept:
    return Kept()


@pytest.fixture
def walked(
    client: Api,
    app: AppContext,
    databases: Databases,
    study_shelf: StudyShelf,
    clock: Clock,
    kept: Kept,
) -> Walked:
    if kept.rows:
        databases.put_into(app.settings.url, kept.rows)
    else:
        study_shelf.put_into(app, LEARNING_PLAN + FROM_PROLIFIC)
        kept.api_token = accounts.create_api_token(
            app, accounts.create(app, EMAIL, PASSWORD), "tests"
        )
        session = client.start(external_ids={"PROLIFIC_PID": PLATFORM_ID, "STUDY_ID": "=1+1"})
        choose = by_turns("skip", "left", "right", "skip", "left")
        kept.pressed = session.to_the_end(choose, clock.forward)
        kept.rows = databases.keep(app.settings.url)
    return Walked(client, kept.api_token, kept.pressed)


def test_queries_hold_exactly_what_was_pressed(walked: Walked) -> None:
    queries = walked.table("queries")
    assert queries.columns.to_list() == QUERIES
    rows = queries[["trial_index", "query_index", "response", "rt"]].itertuples(index=False)
    assert [Pressed(trial + 1, query + 1, *rest) for trial, query, *rest in rows] == walked.pressed

    skipped = queries["response"] == "skip"
    assert queries.loc[skipped, "chosen_candidate"].isna().all()
    for side in ("left", "right"):
        chosen = queries[queries["response"] == side]
        assert (chosen["chosen_candidate"] == chosen[f"{side}_candidate"]).all()


def test_queries_say_what_chose_them_and_what_was_shown(walked: Walked) -> None:
    queries, recordings = walked.table("queries"), walked.table("recordings")
    assert set(queries["trial_type"]) == {"random", "model"}
    assert set(queries.groupby("trial_index")["method"].first()) == {
        "pbpo",
        "pbpo-no-synthesis",
        "pbpo-no-skip",
    }
    assert queries.groupby("trial_index")["seed"].nunique().to_list() == [1, 1, 1]
    by_name = recordings.set_index("recording")
    assert recordings[["rollout", "machine"]].isna().all(axis=None)
    for side in ("left", "right"):
        shown = by_name.loc[queries[f"{side}_recording"]]
        assert shown["candidate"].to_list() == queries[f"{side}_candidate"].to_list()
        for parameter in PARAMETERS:
            values = queries[f"{side}_{parameter}"].to_list()
            assert shown[parameter].to_list() == values


def test_times_are_utc_in_iso_8601_and_in_order(walked: Walked) -> None:
    queries = walked.table("queries")
    assert queries["shown_at"].iloc[0] == "2026-03-01T09:00:00.000Z"
    shown, answered = (pd.to_datetime(queries[name]) for name in ("shown_at", "answered_at"))
    assert str(shown.dt.tz) == "UTC"
    assert ((answered - shown).dt.total_seconds() == 12).all()
    assert answered.is_monotonic_increasing


def test_preferences_come_from_answers_and_of_one_condition_from_skips(walked: Walked) -> None:
    queries, preferences = walked.table("queries"), walked.table("preferences")
    assert preferences.columns.to_list() == PREFERENCES
    for trial, of_trial in queries.groupby("trial_index"):
        learned = preferences[preferences["trial_index"] == trial]
        assert learned["preference_index"].to_list() == list(range(len(learned)))
        by_query = of_trial.set_index("query_index")

        answers = learned[learned["origin"] == "answer"]
        answered = by_query[by_query["response"] != "skip"]
        assert answers["query_index"].to_list() == answered.index.to_list()
        assert answers["winner"].to_list() == answered["chosen_candidate"].to_list()
        sides = answered[["left_candidate", "right_candidate"]].sum(axis=1)
        assert (answers["winner"] + answers["loser"]).to_list() == sides.to_list()
        assert answers["drawn_from_query_index"].isna().all()

        made = learned[learned["origin"] == "synthesis"]
        skipped = by_query[by_query["response"] == "skip"]
        if of_trial["method"].iloc[0] != "pbpo":
            assert made.empty
            continue
        assert len(skipped) == 2
        losers = made.groupby("query_index")["loser"].apply(set).to_dict()
        pairs = skipped[["left_candidate", "right_candidate"]].itertuples()
        assert losers == {index: {left, right} for index, left, right in pairs}
        drawn_from = by_query.loc[made["drawn_from_query_index"]]
        assert drawn_from["chosen_candidate"].to_list() == made["winner"].to_list()


def test_there_is_an_acquired_candidate_after_each_response(walked: Walked) -> None:
    acquired, recordings = walked.table("acquired"), walked.table("recordings")
    assert acquired.columns.to_list() == ACQUIRED
    places = acquired[["trial_index", "query_index"]].to_numpy().tolist()
    assert places == [[pressed.trial - 1, pressed.query - 1] for pressed in walked.pressed]
    points = recordings.drop_duplicates("candidate").set_index("candidate")[PARAMETERS]
    assert points.loc[acquired["candidate"]].to_numpy().tolist() == (
        acquired[PARAMETERS].to_numpy().tolist()
    )
    assert (acquired["posterior_std"] > 0).all()
    assert acquired["sureness"].between(0, 1).all()


def test_sessions_and_participants_tell_how_far_each_one_came(walked: Walked, clock: Clock) -> None:
    stays = walked.client.start().to_first_query()
    stays.respond("left")
    sessions, participants = walked.table("sessions"), walked.table("participants")
    queries = walked.table("queries")

    assert sessions["stage"].to_list() == ["completed", "query"]
    assert sessions["trials_finished"].to_list() == [3, 0]
    assert sessions["ended_at"].isna().to_list() == [False, True]
    order = queries.groupby("trial_index")["condition"].first().to_list()
    assert sessions["conditions"].iloc[0].split("; ") == order
    assert sessions["consent_version"].iloc[0] == queries["consent_version"].iloc[0]
    assert participants["participant_id"].to_list() == sessions["participant_id"].to_list()
    assert participants["sessions"].to_list() == [1, 1]


def test_an_open_query_has_no_response_and_no_time(walked: Walked) -> None:
    walked.client.start().to_first_query()
    still_open = walked.table("queries").iloc[-1]
    assert still_open[["response", "chosen_candidate", "rt", "answered_at"]].isna().all()
    assert still_open["shown_at"].endswith("Z")


def test_events_are_kept_as_the_browser_told_them(client: Api, walked: Walked) -> None:
    session = client.start().to_first_query()
    happened = [
        {"event": "playing", "side": "left", "time_ms": 12.5, "value": None},
        {"event": "focus", "side": None, "time_ms": 800, "value": True},
        {"event": "stalled", "side": "right", "time_ms": 900.25, "value": "=2+2"},
    ]
    session.respond("left", replays=3, rt_ms=4000, events=happened)

    events = walked.table("events")
    assert events.columns.to_list() == EVENTS
    assert events["event"].to_list() == ["playing", "focus", "stalled", "replays"]
    assert events["time_ms"].to_list() == [12.5, 800, 900.25, 4000]
    assert events["side"].fillna("").to_list() == ["left", "", "right", ""]
    assert events["value"].fillna("").to_list() == ["", "True", "'=2+2", "3"]


def test_the_dictionary_lists_every_column_of_every_file_in_order(walked: Walked) -> None:
    dictionary = walked.table("data_dictionary")
    assert dictionary.columns.to_list() == ["file", "column", "type", "unit", "description"]
    for name in (*IN_THE_ZIP, "identities"):
        described = dictionary.loc[dictionary["file"] == f"{name}.csv", "column"].to_list()
        assert described == walked.table(name).columns.to_list()
    assert set(dictionary["type"]) <= {"string", "integer", "number", "boolean", "datetime"}
    assert dictionary["description"].str.len().min() > 3
    assert dictionary["file"].nunique() == len(IN_THE_ZIP) + 1
    units = dictionary.set_index(["file", "column"])["unit"]
    assert (units["queries.csv", "rt"], units["queries.csv", "left_w0"]) == ("ms", "s")


def test_the_types_that_the_dictionary_names_are_those_of_the_cells(walked: Walked) -> None:
    dictionary = walked.table("data_dictionary")
    for name in ("queries", "preferences", "acquired", "sessions", "recordings"):
        table = walked.table(name)
        kinds = dictionary[dictionary["file"] == f"{name}.csv"].set_index("column")["type"]
        for column, kind in kinds.items():
            cells = table[column].dropna()
            if kind == "integer":
                assert (cells == cells.astype("int64")).all(), (name, column)
            elif kind == "number":
                assert pd.api.types.is_numeric_dtype(cells), (name, column)
            elif kind == "datetime":
                assert cells.str.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z").all()


def test_the_zip_holds_the_same_bytes_as_the_tables_and_no_identities(walked: Walked) -> None:
    archive = zipfile.ZipFile(io.BytesIO(walked.get("export.zip")))
    assert archive.testzip() is None
    assert archive.namelist() == [*(f"{name}.csv" for name in IN_THE_ZIP), "README.md"]
    for name in IN_THE_ZIP:
        assert archive.read(f"{name}.csv") == walked.get(f"export/{name}.csv"), name
    assert walked.get("export.zip") == walked.get("export.zip")


def test_tables_for_excel_begin_with_its_mark_and_the_readme_says_how_to_read_them(
    walked: Walked,
) -> None:
    plain = walked.get("export/queries.csv")
    assert walked.get("export/queries.csv?excel=true") == codecs.BOM_UTF8 + plain
    readme = zipfile.ZipFile(io.BytesIO(walked.get("export.zip"))).read("README.md").decode()
    assert "keep_default_na=False" in readme
    assert "read.csv(" in readme


def test_a_filter_that_there_is_not_is_refused_by_name(walked: Walked, client: Api) -> None:
    headers = {"Authorization": f"Bearer {walked.api_token}"}
    for path in ("export/queries.csv", "export.zip", "report.html"):
        answer = client.get(f"/api/v1/studies/short/{path}?participant=P-1", headers=headers)
        assert answer.status_code == 422, path
        assert "participant: expected one of" in answer.text
    answer = client.get("/api/v1/studies/short/export.zip?conditions=pbpo", headers=headers)
    assert "did you mean condition?" in answer.text


def test_head_is_answered_as_get_without_a_body_and_changes_nothing(
    walked: Walked, client: Api, app: AppContext
) -> None:
    before = len(audit_log.trail(app, "short"))
    headers = {"Authorization": f"Bearer {walked.api_token}"}
    for path in ("/sign-in", "/s/short?PROLIFIC_PID=someone", EXPORT):
        answer = client.request("HEAD", path, headers=headers)
        assert (answer.status_code, answer.content) == (200, b""), path
        assert "set-cookie" not in answer.headers, path
    assert client.request("HEAD", EXPORT).status_code == 401
    assert client.request("HEAD", "/nowhere").status_code == 404
    assert len(audit_log.trail(app, "short")) == before


def test_a_platforms_id_is_in_the_identities_and_nowhere_else(walked: Walked) -> None:
    for name in IN_THE_ZIP:
        assert PLATFORM_ID.encode() not in walked.get(f"export/{name}.csv"), name
    identities = walked.table("identities")
    assert identities["key"].to_list() == ["PROLIFIC_PID", "STUDY_ID"]
    assert identities["value"].to_list() == [PLATFORM_ID, "'=1+1"]
    assert set(identities["participant_id"]) == set(walked.table("participants")["participant_id"])


def test_preview_and_simulated_sessions_come_only_when_asked_for(
    client: Api, walked: Walked
) -> None:
    headers = {"Authorization": f"Bearer {walked.api_token}"}
    for mode in ("preview", "simulated"):
        ids = {"PROLIFIC_PID": f"{mode}-person"}
        started = client.post(
            "/api/v1/studies/short/sessions",
            json={"mode": mode, "external_ids": ids},
            headers=headers,
        )
        assert started.status_code == 201
        client.start(mode="preview", by=walked.api_token).to_first_query().respond("left")

    def modes(*asked: str) -> list[str]:
        return sorted(walked.table("sessions", *asked)["mode"])

    assert modes() == ["live"]
    assert modes("simulated") == ["simulated"]
    assert modes("live", "simulated") == ["live", "simulated"]
    assert modes("all") == ["live", "preview", "preview", "preview", "simulated"]
    for name in ("queries", "preferences", "acquired", "participants", "identities"):
        live, everybody = walked.table(name), walked.table(name, "all")
        assert len(live) < len(everybody), name
        assert "preview-person" not in live.to_csv()


def test_a_study_without_sessions_exports_tables_with_their_headers(
    client: Api, learning_study: StudyInfo, api_token: str
) -> None:
    queries = client.table("queries", api_token)
    assert queries.columns.to_list() == QUERIES
    assert queries.empty
    assert len(client.table("recordings", api_token)) == 231 * 5
