"""Two servers and a worker with nothing in common but PostgreSQL and a store: as on machines."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from threading import Barrier

import httpx
import pytest
from sqlalchemy import func, select

from app.crane import library
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.recordings.recordings import CRANE, crane_locator
from app.services.runtime.settings import Settings
from app.services.studies import repository
from app.storage.models.studies import QueryRow, Recording, Response, Trial
from tests.conftest import Idle
from tests.databases import Databases
from tests.s3_server import BUCKET, KEY, SECRET, S3Server

from .own_study import write_own_study
from .served import Served
from .test_killed import CHECKED, Browser, State
from .test_leaving import rows_of_people
from .workers import Worker

#: Candidates that tests render have short videos.
RENDERED = ("env1", 1, 0)

pytestmark = pytest.mark.postgresql


@dataclass(frozen=True)
class Machines:
    """Two servers' addresses, every machine's folder, and the studio as the database has it.

    crane: what browsers know a recording as whose video nobody has made.
    """

    urls: tuple[str, str]
    folders: tuple[Path, ...]
    app: AppContext
    crane: str

    def responses(self) -> list[tuple[int, str]]:
        """Those of the newest trial, each with the place of its query."""
        with self.app.database.read() as db:
            newest = select(func.max(Trial.id)).scalar_subquery()
            rows = db.execute(
                select(QueryRow.query_index, Response.response)
                .join(Response)
                .where(QueryRow.trial_id == newest)
                .order_by(QueryRow.query_index)
            )
            return [(index, response) for index, response in rows]


@pytest.fixture(scope="module")
def machines(databases: Databases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machines]:
    names = ("one", "two", "worker")
    folders = tuple(tmp_path_factory.mktemp(name) for name in names)
    with ExitStack() as ends, pytest.MonkeyPatch.context() as patch:
        store = S3Server()
        ends.callback(store.stop)
        settings = Settings(
            data_dir=folders[2] / "data",
            media_dir=folders[2] / "media",
            database_url=databases.new(folders[0]),
            recordings_url=f"s3://{BUCKET}/lab",
            s3_endpoint=store.url,
            workers_apart=True,
        )
        for name, value in (
            ("AWS_ACCESS_KEY_ID", KEY),
            ("AWS_SECRET_ACCESS_KEY", SECRET),
            ("AWS_CONFIG_FILE", str(folders[0] / "none")),
            ("PBPO_DATABASE_URL", settings.database_url),
            ("PBPO_RECORDINGS_URL", settings.recordings_url),
            ("PBPO_S3_ENDPOINT", settings.s3_endpoint),
            ("PBPO_WORKERS_APART", "true"),
        ):
            patch.setenv(name, value)
        app = open_app(settings, background=Idle(1))
        ends.callback(app.close)
        repository.create(app, repository.load_folder(str(write_own_study(folders[0] / "kettles"))))
        repository.open_study(app, "kettles")
        with app.database.write() as db:
            crane = db.scalars(select(Recording)).first()
            assert crane is not None
            crane.source, crane.locator = CRANE, crane_locator(*RENDERED)
            public_id = crane.public_id
        with ThreadPoolExecutor() as threads:
            worker = threads.submit(Worker, settings, folders[2])
            servers = [
                threads.submit(Served, "serve", folder / "data", folder / "media")
                for folder in folders[:2]
            ]
        for begun in servers:
            ends.enter_context(begun.result())
        ends.enter_context(worker.result())
        one, two = (begun.result().url for begun in servers)
        yield Machines((one, two), folders, app, public_id)


def shown(state: State) -> State:
    """What an evaluator sees of a query, and may press."""
    return {part: state["query"][part] for part in ("id", "left", "right", "skip")}


def test_a_session_goes_on_at_either_server_query_by_query(machines: Machines) -> None:
    one, two = machines.urls
    person = Browser(one)
    person.to_first_query(two)
    answered = 0
    for here, there in cycle([(one, two), (two, one)]):
        while person.state["stage"] not in ("query", "completed"):
            assert person.send(there, "continue") == 200
        if person.state["stage"] == "completed":
            break
        before = shown(person.state)
        assert shown(person.look(here)) == before
        assert person.send(here, "responses", person.body("left")) == 200
        answered += 1
    assert answered == 8
    assert machines.responses() == [(index, "left") for index in range(4)]


def test_one_response_to_both_servers_at_once_is_stored_once(machines: Machines) -> None:
    one, two = machines.urls
    person = Browser(one)
    person.to_first_query(one)
    both = Barrier(2)

    def send(url: str, token: str, body: State) -> httpx.Response:
        both.wait(timeout=30)
        headers = {"Authorization": f"Bearer {token}"}
        return httpx.post(
            f"{url}/api/v1/session/responses", json=body, headers=headers, verify=CHECKED
        )

    with ThreadPoolExecutor(2) as threads:
        for number in (1, 2, 3):
            sent = (person.token, person.body("right"))
            answers = list(threads.map(lambda url, sent=sent: send(url, *sent), machines.urls))
            assert [answer.status_code for answer in answers] == [200, 200]
            assert shown(answers[0].json()) == shown(answers[1].json()) == shown(person.look(two))
            assert machines.responses() == [(index, "right") for index in range(number)]


def test_a_video_that_was_made_for_one_server_plays_from_the_other(machines: Machines) -> None:
    one, two = machines.urls
    first = httpx.get(f"{one}/media/{machines.crane}.mp4", follow_redirects=True, timeout=60)
    second = httpx.get(f"{two}/media/{machines.crane}.mp4", follow_redirects=True)
    assert [answer.status_code for answer in (first, second)] == [200, 200]
    name = library.video_name(*RENDERED)
    made = [[path.name for path in (folder / "media").iterdir()] for folder in machines.folders]
    # The worker has made it; the servers have it from the store.
    assert made == [[], [], [name]]
    assert first.content == second.content == (machines.folders[2] / "media" / name).read_bytes()


def test_what_was_deleted_at_one_server_is_gone_at_the_other(machines: Machines) -> None:
    one, two = machines.urls
    before = rows_of_people(machines.app)
    person = Browser(two)
    person.to_first_query(one)
    for url in (one, two):
        assert person.send(url, "responses", person.body("left")) == 200
    body = person.body("left")
    # Both have looked at the open query, and so work out what may come after it.
    person.look(one)
    assert person.send(one, "withdraw", {"delete": True}) == 200
    after = rows_of_people(machines.app)
    assert after == {**before, "tombstones": before.get("tombstones", 0) + 1}

    headers = {"Authorization": f"Bearer {person.token}"}
    for url in (two, one):
        assert (
            httpx.get(f"{url}/api/v1/session", headers=headers, verify=CHECKED).status_code == 401
        )
        assert person.send(url, "responses", body) == 401
    assert rows_of_people(machines.app) == after
