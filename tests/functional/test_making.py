"""Making a study in the browser: from a zip, from loose files, from nothing."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from app.services.accounts.accounts import Role
from app.services.accounts.audit_log import trail
from app.services.context import AppContext
from app.services.studies import repository
from tests.conftest import SHORT_PLAN, write_study

from .client import Api
from .desk import Desk, zipped
from .own_study import write_own_study


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_own_study(tmp_path_factory.mktemp("made") / "kettles")


@pytest.fixture
def desk(client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "mo@lab.example", Role.EXPERIMENTER)


def broken(folder: Path, target: Path) -> Path:
    """The study with three faults, each in a file of its own."""
    shutil.copytree(folder, target)
    plan = target / "study.yaml"
    plan.write_text(plan.read_text().replace("queries_per_trial: 4", "queries_per_trial: many"))
    table = target / "recordings.csv"
    table.write_text(table.read_text().replace("0.2,1,videos/c.mp4", "fast,1,videos/c.mp4"))
    (target / "videos" / "d.mp4").write_bytes(b"no video at all")
    return target


def test_a_zip_becomes_a_study_of_the_one_who_sent_it(
    desk: Desk, app: AppContext, folder: Path
) -> None:
    here = desk.begin({"kettles.zip": zipped(folder, "kettles/")})
    page = desk.get(here)
    assert "No fault found" in page.text
    assert "4 recordings" in page.text
    assert here in desk.get("/studies").text
    made = desk.post(f"{here}/create")
    assert (made.status_code, made.headers["location"]) == (303, "/studies/kettles")
    assert repository.find(app, "kettles").status == "draft"
    assert desk.get("/studies/kettles").status_code == 200
    assert desk.get(here).status_code == 404
    assert not (app.settings.uploads_dir / here.strip("/")).exists()
    entry = trail(app, "kettles")[0]
    assert (entry.actor, entry.action) == ("mo@lab.example", "study created")


def test_files_that_are_at_another_server_are_said_to_be_and_can_be_given_up(
    desk: Desk, app: AppContext, folder: Path
) -> None:
    here = desk.begin({"kettles.zip": zipped(folder)})
    shutil.rmtree(app.settings.uploads_dir)
    for answer in (desk.get(here), desk.post(f"{here}/create"), desk.post(f"{here}/transcode")):
        assert answer.status_code == 404
        assert "begun at another one" in answer.text
    assert desk.post(f"{here}/discard").status_code == 303
    assert here not in desk.get("/studies").text


def test_every_fault_is_named_at_once_with_file_row_expectation_and_what_came(
    desk: Desk, folder: Path, tmp_path: Path
) -> None:
    here = desk.begin({"kettles.zip": zipped(broken(folder, tmp_path / "broken"))})
    page = desk.get(here).text
    assert "3 faults to put right" in page
    rows = re.findall(
        r'<tr><td class="number">(.+?)</td><td>(.*?)</td><td>(.*?)</td><td>(.*?)</td>', page
    )
    cells = [tuple(re.sub("<.*?>", "", cell) for cell in row) for row in rows]
    assert cells[0] == ("4", "speed", "a finite number", "&#39;fast&#39;")
    assert cells[1][:3] == ("5", "file", "a video that can be played")
    assert cells[2][:3] == ("18", "queries_per_trial", "a whole number from 1 to 1000")
    assert cells[2][3] == "&#39;many&#39;"
    assert desk.post(f"{here}/create").status_code == 422


def test_faults_are_put_right_by_words_on_a_page_and_by_files_sent_again(
    desk: Desk, folder: Path, tmp_path: Path, app: AppContext
) -> None:
    here = desk.begin({"kettles.zip": zipped(broken(folder, tmp_path / "broken"))})
    shown = desk.get(f"{here}/text?file=study.yaml").text
    assert "queries_per_trial: many" in shown
    assert "a whole number from 1 to 1000" in shown
    text = (folder / "study.yaml").read_text()
    assert desk.post(f"{here}/text", file="study.yaml", text=text).status_code == 303
    assert "2 faults" in desk.get(here).text
    # Sent by their bare names, as browsers do: they take the place of what is called so.
    again = {name: (folder / "videos" / name).read_bytes() for name in ("d.mp4",)}
    again["recordings.csv"] = (folder / "recordings.csv").read_bytes()
    assert desk.send(f"{here}/files", again).status_code == 303
    assert "No fault found" in desk.get(here).text
    assert desk.post(f"{here}/create").status_code == 303
    assert repository.recording_count(app, repository.find(app, "kettles").id) == 4


def test_videos_beside_a_csv_begin_a_study_of_its_columns(desk: Desk, folder: Path) -> None:
    files = {path.name: path.read_bytes() for path in (folder / "videos").iterdir()}
    files["recordings.csv"] = (folder / "recordings.csv").read_bytes()
    files["consent.md"] = b"You choose between videos.\n"
    here = desk.begin(files, name="Pouring water, 2")
    plan = desk.get(f"{here}/text?file=study.yaml").text
    assert "slug: &#34;pouring-water-2&#34;" in plan
    assert "- {name: speed}\n  - {name: height}\n" in plan
    page = desk.get(here).text
    # The videos lie where the CSV says; what is left are the example's texts, to be filled in.
    assert "videos/a.mp4" in page
    assert "texts/en/instructions.md" in page
    # They are work to do, and no faults.
    assert set(re.findall(r"Fill in (.+?)</a>", page)) == {
        "texts/en/instructions.md",
        "texts/en/debrief.md",
    }
    assert "to put right" not in page
    assert re.findall(r'<li data-state="(.+?)"', page) == ["done", "next", "done", "later", "later"]
    assert "As it will be read" in desk.get(f"{here}/text?file=texts/en/debrief.md").text


def test_a_study_can_be_begun_from_its_settings_alone(desk: Desk) -> None:
    here = desk.begin({}, name="Nothing yet")
    page = desk.get(here).text
    assert "recordings.csv" in page
    assert "there is none" in page
    assert desk.get(f"{here}/text?file=texts/en/consent.md").status_code == 200


def test_a_draft_is_nobodys_but_its_makers(
    desk: Desk, client: Api, app: AppContext, folder: Path
) -> None:
    here = desk.begin({"kettles.zip": zipped(folder)})
    for role in (Role.ADMIN, Role.REVIEWER):
        other = Desk(client, app, f"{role}@lab.example", role)
        assert other.get(here).status_code == 404
        assert other.get(f"{here}/text?file=study.yaml").status_code == 404
        assert other.send(f"{here}/files", {"a.csv": b""}).status_code == 404
        for doing in ("create", "discard", "remove", "text"):
            answer = other.post(f"{here}/{doing}", file="study.yaml", text="")
            assert answer.status_code == 404, doing
    assert desk.get(here).status_code == 200
    client.cookies.clear()
    assert client.get(here).headers["location"] == f"/sign-in?next={here}"


def test_a_reviewer_makes_no_study(client: Api, app: AppContext) -> None:
    reviewer = Desk(client, app, "rev@lab.example", Role.REVIEWER)
    assert "Make a study" not in reviewer.get("/studies").text
    assert reviewer.get("/studies/new").status_code == 403
    assert reviewer.send("/drafts", {}, name="x").status_code == 403


def test_a_form_that_is_not_ours_brings_no_file(desk: Desk, app: AppContext) -> None:
    desk.csrf = "0" * 64
    assert desk.send("/drafts", {"a.csv": b"x"}).status_code == 403
    assert desk.send("/drafts", {"a.csv": b"x"}, csrf_token="").status_code == 403
    assert list((app.settings.uploads_dir).rglob("*.csv")) == []


def test_somebody_elses_draft_study_is_not_replaced(
    desk: Desk, client: Api, app: AppContext, folder: Path
) -> None:
    here = desk.begin({"kettles.zip": zipped(folder)})
    assert desk.post(f"{here}/create").status_code == 303
    other = Desk(client, app, "zoe@lab.example", Role.EXPERIMENTER)
    theirs = other.begin({"kettles.zip": zipped(folder)})
    answer = other.post(f"{theirs}/create")
    assert answer.status_code == 422
    assert "taken" in answer.text
    mine_again = desk.begin({"kettles.zip": zipped(folder)})
    assert desk.post(f"{mine_again}/create").status_code == 303


def test_a_study_is_not_called_as_a_page_is(desk: Desk, tmp_path: Path) -> None:
    plan = SHORT_PLAN.replace("slug: short", "slug: new")
    here = desk.begin({"new.zip": zipped(write_study(tmp_path / "new", plan))})
    answer = desk.post(f"{here}/create")
    assert answer.status_code == 422
    assert "another slug" in answer.text


def test_a_draft_is_thrown_away_with_its_files(desk: Desk, app: AppContext, folder: Path) -> None:
    here = desk.begin({"kettles.zip": zipped(folder)})
    place = app.settings.uploads_dir / here.strip("/")
    assert (place / "study.yaml").is_file()
    assert desk.post(f"{here}/remove", file="videos/a.mp4").status_code == 303
    assert not (place / "videos" / "a.mp4").exists()
    assert "there is no file" in desk.get(here).text
    assert desk.post(f"{here}/remove", file="videos/a.mp4").status_code == 404
    assert desk.post(f"{here}/discard").status_code == 303
    assert not place.exists()
    assert desk.get(here).status_code == 404


@pytest.mark.parametrize("name", ["../study.yaml", "/etc/passwd", "videos/a.mp4", ".hidden.csv"])
def test_no_other_file_is_read_or_written_as_a_text(desk: Desk, folder: Path, name: str) -> None:
    here = desk.begin({"kettles.zip": zipped(folder)})
    assert desk.get(f"{here}/text?file={name}").status_code in (409, 422)
    assert desk.post(f"{here}/text", file=name, text="x").status_code in (409, 422)


def test_the_form_and_the_file_are_one_thing(desk: Desk, folder: Path, app: AppContext) -> None:
    here = desk.begin({"kettles.zip": zipped(folder)})
    shown = desk.get(f"{here}/settings").text
    assert 'value="with skip"' in shown
    given = dict(re.findall(r'<input[^>]* name="([^"]+)"[^>]* value="([^"]*)"', shown))
    given |= {"method:0": "pbpo", "environment:0": "kitchen", "platform": "none"}
    given |= {"method:1": "knockout", "environment:1": "kitchen"}
    given |= {"queries": "6", "places": "12", "csrf_token": desk.csrf}
    assert desk.post(f"{here}/settings", **given).status_code == 303
    text = (app.settings.uploads_dir / here.strip("/") / "study.yaml").read_text()
    expected = (folder / "study.yaml").read_text().replace("trial: 4", "trial: 6")
    assert text.replace("places: 12\n", "").strip() == expected.strip()
    assert 'value="6"' in desk.get(f"{here}/settings").text
    given |= {"candidates": "ranges", "constraints": "speed <= 2\r\n\r\nspeed >= 1", "lag:0": "7"}
    del given["base"]
    desk.post(f"{here}/settings", **given)
    assert "rollout.lag</code></td><td>0 or 1</td><td>7</td>" in desk.get(here).text
    file = app.settings.uploads_dir / here.strip("/") / "study.yaml"
    text = file.read_text()
    shown = desk.get(f"{here}/settings").text
    assert re.search(r'name="constraints"[^>]*>speed &lt;= 2\nspeed &gt;= 1</textarea>', shown)
    given = {"constraints": "speed <= 2\r\nspeed >= 1", "places": "13", "csrf_token": desk.csrf}
    desk.post(f"{here}/settings", **given, languages="en, ja")
    assert file.read_text() == text.replace("places: 12", "places: 13")
    desk.post(f"{here}/text", file="study.yaml", text="slug: [")
    assert desk.get(f"{here}/settings").status_code == 422
