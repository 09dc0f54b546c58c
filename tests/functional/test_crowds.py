"""What `make load` and `make chaos` hold: that they would see it if something were lost."""

from __future__ import annotations

from sqlalchemy import delete, update

from app.services.studies import StudyInfo
from app.services.studio import Studio
from app.storage.tables import QueryRow, Response
from tests.load.crowd import Log
from tests.load.stored import faults_in

from .client import Api


def test_what_was_acknowledged_is_looked_for_and_what_nobody_was_told_of_is_seen(
    client: Api, studio: Studio, short_study: StudyInfo
) -> None:
    session = client.start().to_first_query()
    told = []
    for response in ("left", "right", "left"):
        told.append((session.state["query"]["id"], response))
        session.respond(response)
    on_its_way = {(session.token, *told[-1])}

    def found(acknowledged: list[tuple[str, str]], *, in_hand: bool = False) -> str:
        log = Log(acknowledged={session.token: acknowledged})
        return "; ".join(faults_in(studio, "short", log, on_its_way if in_hand else set()))

    assert found(told) == ""
    assert found(told[:2], in_hand=True) == ""
    assert "1 responses are stored that nobody was told of" in found(told[:2])
    assert "1 acknowledged responses are not stored" in found([*told[:2], (told[2][0], "right")])

    with studio.database.write() as row:
        query = QueryRow.public_id == told[0][0]
        left, right = QueryRow.left_candidate, QueryRow.right_candidate
        row.execute(update(QueryRow).where(query).values({left: right, right: left}))
    assert "queries are not what their history says" in found(told)
    with studio.database.write() as row:
        row.execute(delete(Response))
    assert "3 acknowledged responses are not stored" in found(told)
