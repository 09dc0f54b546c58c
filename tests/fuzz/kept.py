"""What is stored of people, held against what they were told was taken."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable, Iterator

from sqlalchemy import delete, func, select

from app.services.context import AppContext
from app.services.sessions import replay as replaying
from app.storage.models.arrivals import Tombstone
from app.storage.models.studies import Base, Participant
from tests.functional.test_leaving import OF_THE_STUDY

from .person import COURSE, Person, Pressed
from .told import Seats, World

#: Everything but what a study has before anybody came, and those who run it.
_TABLES_OF_PEOPLE = [
    table for table in Base.metadata.sorted_tables if table.name not in OF_THE_STUDY
]


def delete_all_people(app: AppContext) -> None:
    """As before anybody came."""
    with app.database.write() as db:
        db.execute(delete(Participant))
        db.execute(delete(Tombstone))


def compare(app: AppContext, seats: Seats) -> None:
    """Exports and tables say what the people did; then all have it deleted, and nothing is left."""
    people = seats.people
    tokens = [person.session.token for person in people]
    assert not _found(app, [one.name for one in people if one.ended == "deleted"] + tokens)

    stays = {person.name: person for person in people if person.ended != "deleted"}
    exported = _Exported(seats.world, stays)
    assert exported.responses("queries") == Counter(
        row for name, person in stays.items() for row in _standing(name, person)
    )
    assert exported.responses("undone") == Counter(
        _row(name, one.at, one) for name, person in stays.items() for _, one in person.undone
    )
    assert exported.answers() == Counter(
        (name, *map(str, answer)) for name, person in stays.items() for answer in person.answers
    )
    known = sorted(row["value"] for row in exported.table("identities"))
    assert known == sorted(name for name, one in stays.items() if one.ended != "declined")
    assert exported.stages() == {name: person.stage for name, person in stays.items()}
    assert len(exported.table("events")) == sum(person.events for person in stays.values())
    assert sorted(row["stage"] for row in exported.table("deletions")) == sorted(seats.deleted_at)

    for trial in replaying.replay(app, "short"):
        assert not trial.differences, trial

    for person in stays.values():
        answer = person.session.call("withdraw", {"delete": True})
        assert answer.status_code == 200, answer.text
    assert not _found(app, [person.name for person in people])
    assert _rows_of_people(app) == {"tombstones": len(people)}


def _standing(name: str, person: Person) -> Iterator[tuple[str, ...]]:
    """Each query that stands, and its response; the open one has none."""
    for at, query_id in person.standing.items():
        yield _row(name, at, person.pressed.get(query_id))


def _row(name: str, at: int, one: Pressed | None) -> tuple[str, ...]:
    place = COURSE[at]
    said = ("", "") if one is None else (one.response, f"{one.rt_ms}.0")
    return (name, str(place.trial), str(place.query), *said)


class _Exported:
    """An experimenter's tables, with people by their names: sessions come in their order."""

    def __init__(self, world: World, names: Iterable[str]) -> None:
        self._client = world.client
        self._headers = {"Authorization": f"Bearer {world.api_token}"}
        self._sessions = self.table("sessions")
        ids = (row["session_id"] for row in self._sessions)
        self._names = dict(zip(ids, names, strict=True))

    def table(self, name: str) -> list[dict[str, str]]:
        path = f"/api/v1/studies/short/export/{name}.csv"
        answer = self._client.get(path, headers=self._headers)
        assert answer.status_code == 200, answer.text
        return list(csv.DictReader(io.StringIO(answer.text, newline="")))

    def stages(self) -> dict[str, str]:
        return {self._names[row["session_id"]]: row["stage"] for row in self._sessions}

    def answers(self) -> Counter[tuple[str, ...]]:
        return self._rows("questionnaires", "trial_index", "item", "value")

    def responses(self, table: str) -> Counter[tuple[str, ...]]:
        return self._rows(table, "trial_index", "query_index", "response", "rt")

    def _rows(self, table: str, *columns: str) -> Counter[tuple[str, ...]]:
        return Counter(
            (self._names[row["session_id"]], *(row[column] for column in columns))
            for row in self.table(table)
        )


def _found(app: AppContext, secrets: Iterable[str]) -> list[str]:
    """Those of these texts that stand anywhere in the database."""
    with app.database.read() as db:
        cells = [
            cell
            for table in _TABLES_OF_PEOPLE
            for row in db.execute(select(table))
            for cell in row
            if isinstance(cell, str)
        ]
    return [secret for secret in secrets if any(secret in cell for cell in cells)]


def _rows_of_people(app: AppContext) -> dict[str, int]:
    with app.database.read() as db:
        counted = {
            table.name: db.scalar(select(func.count()).select_from(table)) or 0
            for table in _TABLES_OF_PEOPLE
        }
    return {name: number for name, number in counted.items() if number}
