"""Two who change the same thing: the second is told, sees both, and loses nothing typed."""

from __future__ import annotations

import html
import re
from pathlib import Path

import pytest

from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.studies import repository
from app.study.text_diff import difference
from tests.conftest import SHORT_PLAN, write_study

from .client import Api
from .desk import Desk


@pytest.fixture
def desk(client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "mo@lab.example", Role.EXPERIMENTER)


@pytest.fixture
def short(desk: Desk, app: AppContext, tmp_path: Path) -> str:
    """A draft of the experimenter's own: its page."""
    folder = write_study(tmp_path / "short", SHORT_PLAN)
    repository.create(app, repository.load_folder(str(folder)), desk.account.account_id)
    return "/studies/short"


def form(page: str) -> dict[str, str]:
    """What the form of a page would send if nothing were changed."""
    texts = re.findall(r'<textarea[^>]*name="([^"]+)"[^>]*>\n?(.*?)</textarea>', page, re.DOTALL)
    inputs = re.findall(r'<input[^>]*name="([^"]+)"[^>]*value="([^"]*)"', page)
    found = {name: html.unescape(value) for name, value in (*inputs, *texts)}
    for name, options in re.findall(r'<select name="([^"]+)">(.*?)</select>', page, re.DOTALL):
        chosen = re.search(r'<option(?: value="([^"]*)")? selected>([^<]*)', options)
        found[name] = (chosen[1] or chosen[2]) if chosen else ""
    found.pop("csrf_token", None)
    return found


def test_a_consent_is_not_taken_back_by_who_revises_the_debrief(
    desk: Desk, app: AppContext, short: str
) -> None:
    ann, bob = (form(desk.get(f"{short}/texts").text) for _ in range(2))
    ann["en/consent"] += "\nAnn's sentence.\n"
    bob["en/debrief"] += "\nBob's sentence.\n"
    assert desk.post(f"{short}/texts", **ann).status_code == 303
    refused = desk.post(f"{short}/texts", **bob)
    assert refused.status_code == 409
    assert "revised by someone else" in refused.text
    assert "yours  Bob&#39;s sentence." in refused.text
    slug = short.rpartition("/")[2]
    assert repository.find(app, slug).plan_version == 2
    # Saved again as it is shown, both are there.
    again = form(refused.text)
    assert "Ann's sentence." in again["en/consent"]
    assert "Bob's sentence." in again["en/debrief"]
    assert desk.post(f"{short}/texts", **again).status_code == 303
    texts = repository.find(app, slug).texts["en"]
    assert "Ann's" in texts["consent"]
    assert "Bob's" in texts["debrief"]


def test_of_two_who_revise_one_text_both_are_shown(desk: Desk, short: str) -> None:
    ann, bob = (form(desk.get(f"{short}/texts").text) for _ in range(2))
    ann["en/consent"] = "Ann's consent.\n"
    bob["en/consent"] = "Bob's consent.\n"
    assert desk.post(f"{short}/texts", **ann).status_code == 303
    refused = desk.post(f"{short}/texts", **bob)
    assert "stored Ann&#39;s consent." in refused.text
    assert "yours  Bob&#39;s consent." in refused.text
    assert form(refused.text)["en/consent"] == "Bob's consent.\n"
    # A third text that comes in between is not lost either.
    third = form(desk.get(f"{short}/texts").text)
    third["en/consent"] = "Third.\n"
    assert desk.post(f"{short}/texts", **third).status_code == 303
    assert desk.post(f"{short}/texts", **form(refused.text)).status_code == 409


def test_the_same_words_twice_are_no_clash(desk: Desk, short: str) -> None:
    ann, bob = (form(desk.get(f"{short}/texts").text) for _ in range(2))
    for one in (ann, bob):
        one["en/consent"] = "The same.\n"
        assert desk.post(f"{short}/texts", **one).status_code == 303


@pytest.mark.parametrize("file", ["study.yaml", "notes.md"])
def test_a_drafts_file_in_two_tabs(desk: Desk, file: str) -> None:
    here = desk.begin({}, name="Two tabs")
    first, second = (form(desk.get(f"{here}/text?file={file}").text) for _ in range(2))
    first["text"] += "# the first tab's\n"
    second["text"] += "# the second tab's\n"
    assert desk.post(f"{here}/text", **first).status_code == 303
    refused = desk.post(f"{here}/text", **second)
    assert refused.status_code == 409
    assert "stored # the first tab&#39;s" in refused.text
    assert "# the second tab's" in form(refused.text)["text"]
    assert "the first tab" in desk.get(f"{here}/text?file={file}").text
    assert desk.post(f"{here}/text", **form(refused.text)).status_code == 303
    assert "the second tab" in desk.get(f"{here}/text?file={file}").text


def test_settings_over_a_file_that_was_changed(desk: Desk) -> None:
    here = desk.begin({}, name="Two tabs")
    typed = form(desk.get(f"{here}/settings").text)
    file = form(desk.get(f"{here}/text?file=study.yaml").text)
    file["text"] = file["text"].replace("queries_per_trial: 30", "queries_per_trial: 31")
    file["text"] += "\n# by hand\n"
    assert desk.post(f"{here}/text", **file).status_code == 303
    typed["title:en"] = "Typed in the form"
    refused = desk.post(f"{here}/settings", **typed)
    assert refused.status_code == 409
    assert "yours Typed in the form" in refused.text
    assert "# by hand" in desk.get(f"{here}/text?file=study.yaml").text
    assert "Typed in the form" not in desk.get(f"{here}/text?file=study.yaml").text
    assert desk.post(f"{here}/settings", **form(refused.text)).status_code == 303
    text = desk.get(f"{here}/text?file=study.yaml").text
    assert "Typed in the form" in text
    assert "# by hand" in text


def test_conditions_that_were_switched_meanwhile_are_not_switched_back(
    desk: Desk, app: AppContext, tmp_path: Path
) -> None:
    plan = SHORT_PLAN.replace("slug: short", "slug: two")
    if "name: no-skip" not in plan:
        plan = plan.replace(
            "conditions:\n",
            "conditions:\n  - {name: no-skip, method: pbpo-no-skip, environment: env1}\n",
        )
    folder = write_study(tmp_path / "two", plan)
    study = repository.create(app, repository.load_folder(str(folder)), desk.account.account_id)
    names = [condition.name for condition in study.plan.conditions]
    seen = form(desk.get("/studies/two/recruit").text)["was_off"]
    one = desk.post("/studies/two/conditions", on=names[:1], was_off=seen)
    assert one.status_code == 303
    other = desk.post("/studies/two/conditions", on=names[1:], was_off=seen)
    assert (other.status_code, "were switched since" in other.text) == (409, True)
    assert repository.find(app, "two").conditions_off == tuple(names[1:])
    seen = form(other.text)["was_off"]
    assert desk.post("/studies/two/conditions", on=names[1:], was_off=seen).status_code == 303


def test_a_difference_is_that_of_the_lines() -> None:
    lines = difference("a\nb\nc\nd\ne\nf\n", "a\nb\nc\nX\ne\nf\n")
    assert [f"{line.sign}{line.text}" for line in lines] == [" b", " c", "-d", "+X", " e", " f"]
    assert difference("same", "same") == []
    assert len(difference("x\n" * 5_000, "y\n" * 5_000)) == 1
