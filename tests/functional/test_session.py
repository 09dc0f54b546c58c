"""A session through the API, as the contract has it."""

from __future__ import annotations

from app.services.studies import StudyInfo

from .client import Api


def test_a_session_goes_from_consent_to_its_first_query(
    client: Api, short_study: StudyInfo
) -> None:
    session = client.start()
    assert session.state["stage"] == "consent"
    assert session.state["progress"] == {"trial": 0, "trials": 3, "query": 0, "queries": 4}

    assert session.consent().json()["stage"] == "instructions"
    familiarisation = session.go_on().json()
    assert familiarisation["stage"] == "familiarisation"
    assert len(familiarisation["familiarisation"]["videos"]) == 2
    query = session.go_on().json()
    assert query["stage"] == "query"
    assert query["progress"] == {"trial": 1, "trials": 3, "query": 1, "queries": 4}
    assert query["query"]["left"]["url"] != query["query"]["right"]["url"]
