"""The privacy page names all that is kept, and nothing that is not so."""

from __future__ import annotations

import html
import re
from pathlib import Path

import pytest
from fastapi import FastAPI

import app as program
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.ethics import data_inventory
from app.services.ethics.personal_data import BROWSER, EVALUATORS, OTHERS, Topic, topics
from app.storage.models.studies import Base
from app.web.evaluator.privacy_sentences import SENTENCES

from .client import Api
from .conftest import Recruit
from .desk import Desk
from .test_privacy import ASKING
from .test_recruitment import PROLIFIC

ROOT = Path(program.__file__).parents[1]
SINGLE_USE = "recruitment: {links: single-use}\n"


def page(client: Api, language: str = "en") -> str:
    answer = client.get(f"/s/short/privacy?lang={language}")
    assert answer.status_code == 200
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", answer.text)).split())


def spoken(topic: Topic) -> str:
    """The sentence as a page says it, up to what differs from study to study."""
    return SENTENCES[topic].split("%(")[0].strip()


def test_every_table_and_every_column_has_a_topic_with_a_sentence() -> None:
    assert data_inventory  # all modules of tables are there
    tables = Base.metadata.tables
    assert EVALUATORS.keys() | OTHERS == set(tables)
    assert EVALUATORS.keys() & OTHERS == set()
    for name, by_topic in EVALUATORS.items():
        said = [column for columns in by_topic.values() for column in columns.split()]
        assert sorted(said) == sorted(column.name for column in tables[name].columns), name
    used = {topic for by_topic in EVALUATORS.values() for topic in by_topic}
    assert (used | {*BROWSER.values()}) - {Topic.NOT_EVALUATORS} <= set(SENTENCES)
    assert set(Topic) - {Topic.NOT_EVALUATORS} == set(SENTENCES)


def test_whatever_hangs_on_a_person_is_about_evaluators() -> None:
    """A table that points at people or their sessions cannot be said to be about others."""
    people = {"participants"}
    while True:
        found = people | {
            table.name
            for table in Base.metadata.tables.values()
            if any(key.column.table.name in people for key in table.foreign_keys)
        }
        if found == people:
            break
        people = found
    assert {"identities", "sessions", "responses", "events"} < people
    assert people & OTHERS == set()


def test_every_place_in_the_browser_has_a_topic() -> None:
    found = set()
    for script in (ROOT / "static" / "js").rglob("*.js"):
        if script.name == "storage.js":
            continue  # what the others write through
        for storage in re.findall(
            r'store\(\s*"(localStorage|sessionStorage)"|\b(localStorage|sessionStorage)\.setItem'
            r"|document\.(cookie)\s*=|\b(indexedDB|caches)\.open",
            script.read_text("utf-8"),
        ):
            found.add(f"{next(filter(None, storage))} {script.name}")
    for module in (ROOT / "app" / "web").rglob("*.py"):
        if re.search(r"\bset_cookie\(", module.read_text("utf-8")):
            found.add(f"cookie {module.name}")
    assert found == set(BROWSER)


def test_a_study_with_everything_says_everything(client: Api, recruit: Recruit) -> None:
    study = recruit(PROLIFIC + ASKING)
    said = page(client)
    for topic in topics(study.plan, videos_elsewhere=False):
        assert spoken(topic) in said, topic
    assert spoken(Topic.PERSONAL_LINK) not in said
    assert spoken(Topic.IDENTIFIERS).split(" that ")[0] in said


def test_a_study_of_personal_links_says_so(client: Api, recruit: Recruit) -> None:
    recruit(SINGLE_USE)
    said = page(client)
    assert spoken(Topic.PERSONAL_LINK) in said
    for topic in (Topic.IDENTIFIERS, Topic.DEVICE, Topic.QUESTIONS):
        assert spoken(topic) not in said


def test_the_ethics_page_says_the_same_to_the_board(
    client: Api, app: AppContext, recruit: Recruit
) -> None:
    recruit("")
    reviewer = Desk(client, app, "rev@lab.example", Role.REVIEWER)
    said = html.unescape(reviewer.get("/studies/short/ethics").text)
    for topic in (Topic.OTHER_SITES, Topic.BROWSER, Topic.BACKUPS, Topic.LOGS):
        assert SENTENCES[topic] in said
    assert "None are kept" in said


@pytest.mark.parametrize("elsewhere", [None, "https://videos.example:9000"])
def test_other_sites_are_named_where_videos_come_from_one(
    client: Api,
    application: FastAPI,
    recruit: Recruit,
    app: AppContext,
    monkeypatch: pytest.MonkeyPatch,
    elsewhere: str | None,
) -> None:
    recruit("")
    monkeypatch.setattr(type(app.recordings), "origin", elsewhere)
    said = page(client)
    assert ("videos.example:9000, which learns your IP address" in said) == (elsewhere is not None)
    assert (SENTENCES[Topic.OTHER_SITES] in said) == (elsewhere is None)
    assert "%(" not in said
