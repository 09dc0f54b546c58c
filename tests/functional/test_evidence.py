"""What the browser saw of each query, summed up: evidence.csv."""

from __future__ import annotations

from typing import Any

import pandas as pd

from app.services.studies.repository import StudyInfo

from .client import Api

COLUMNS = [
    *(
        "session_id",
        "trial_index",
        "condition",
        "query_index",
        "replays",
        "left_watched",
        "right_watched",
    ),
    *("dropped_frames", "stalls", "start_skew_ms", "worst_drift_ms", "left_width_px"),
    *("right_width_px", "hidden", "blurred", "fullscreen"),
    *("pressed_with", "layout", "turns", "resizes"),
]


def happened(event: str, side: str | None = None, value: Any = None) -> dict[str, Any]:
    return {"event": event, "side": side, "time_ms": 100, "value": value}


WATCHED = [
    happened("shown"),
    happened("visible"),
    happened("playing", "left"),
    happened("start_skew", None, 12),
    happened("stall", "right"),
    happened("stall", "left"),
    happened("hidden"),
    happened("fullscreen", None, 1),
    happened("fullscreen", None, 0),
    happened("replay"),
    happened("watched", "left", 0.5),
    happened("watched", "right", 1),
    happened("width", "left", 640),
    happened("width", "right", 639),
    happened("dropped_frames", "left", 3),
    happened("dropped_frames", "right", 4),
    happened("worst_drift", None, 21),
    happened("layout", None, "side_by_side"),
    happened("turned", None, "portrait"),
    happened("resized", None, "390x844"),
    happened("resized", None, "390x800"),
    happened("layout", None, "stacked"),
    happened("pressed", None, "pen"),
]


def test_a_row_sums_up_how_a_query_was_watched(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start().to_first_query()
    session.respond("left", replays=1, rt_ms=900, events=WATCHED)
    evidence = client.table("evidence", api_token)
    assert evidence.columns.to_list() == COLUMNS
    (row,) = evidence.drop(columns=["session_id", "condition"]).to_numpy().tolist()
    seen = [0, 0, 1, 0.5, 1, 7, 2, 12, 21, 640, 639, True, False, True]
    assert row == [*seen, "pen", "stacked", 1, 2]


def test_there_is_a_row_for_each_answered_query_and_no_guess_where_nothing_was_told(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    first = client.start().to_first_query()
    first.respond("left")
    first.respond("right", events=[happened("shown"), happened("watched", "left", "=nonsense")])
    first.respond("left", events=WATCHED)
    client.start().to_first_query().respond("left", events=[happened("blur")])
    evidence = client.table("evidence", api_token)
    assert evidence["query_index"].to_list() == [0, 1, 2, 0]
    assert evidence.iloc[0, 4:].isna().all()
    assert evidence["stalls"].fillna(-1).to_list() == [-1, 0, 2, 0]
    assert pd.isna(evidence["left_watched"].iloc[1])
    assert evidence["blurred"].fillna("").to_list() == ["", False, False, True]


def test_what_was_seen_of_a_pair_that_did_not_play_is_no_evidence_for_the_answer(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start().to_first_query()
    query_id = session.state["query"]["id"]
    session.call("faults", {"query_id": query_id, "events": WATCHED})
    session.respond("left", events=[happened("shown"), happened("stall", "left")])
    (stalls,) = client.table("evidence", api_token)["stalls"]
    assert stalls == 1
    events = client.table("events", api_token)["event"].to_list()
    assert events == [*(event["event"] for event in WATCHED), "set_aside", "shown", "stall"]
