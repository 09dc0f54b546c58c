"""The commands, as they are typed: what they say, where, and with which exit status."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pytest
from sqlalchemy import select

from app import cli
from app.main import create_app
from app.services.accounts import accounts
from app.services.bootstrap import open_app
from app.services.export import ZIPPED
from app.services.runtime.settings import Settings
from app.storage.database import Database
from app.storage.models.studies import Acquired, PreferenceRow, QueryRow
from tests.conftest import Idle, StudyShelf, write_study
from tests.videos import write as write_video

from .client import Api
from .conftest import EMAIL, LEARNING_PLAN, PASSWORD
from .machine_study import ROBOT_PLAN
from .own_study import write_own_study


@dataclass(frozen=True)
class Said:
    """What a command said, and how it ended."""

    status: int
    out: str
    err: str


Run = Callable[..., Said]

COMMANDS = [
    *([], ["demo"], ["serve"], ["study"], ["study", "init"], ["study", "check"]),
    *(["study", "create"], ["study", "list"], ["study", "open"], ["study", "close"], ["export"]),
    ["report"],
    *(
        ["simulate"],
        ["power"],
        ["media", "render"],
        ["replay"],
        ["account", "create"],
        ["account", "token"],
    ),
]


@pytest.fixture
def pbpo(
    tmp_path: Path,
    media_dir: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Run:
    """Runs a command on a data folder of the test's own."""
    monkeypatch.setenv("PBPO_DATA_DIR", str(tmp_path / "data"))
    monkeypatch.setenv("PBPO_MEDIA_DIR", str(media_dir))

    def run(*words: object) -> Said:
        monkeypatch.setattr(sys, "argv", ["pbpo", *map(str, words)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            cli.main()
        said = capsys.readouterr()
        assert isinstance(left.value.code, int)
        return Said(left.value.code, said.out, said.err)

    return run


@pytest.fixture
def stocked(pbpo: Run, study_shelf: StudyShelf, tmp_path: Path, media_dir: Path) -> Run:
    """The same with an open study, `short`, whose model chooses queries after two answers."""
    app = open_app(Settings(data_dir=tmp_path / "data", media_dir=media_dir), background=Idle(1))
    study_shelf.put_into(app, LEARNING_PLAN)
    app.close()
    return pbpo


def mistake(said: Said) -> str:
    """The one line that a user's mistake is answered with."""
    assert said.status == 2, said
    assert said.out == ""
    assert len(said.err.splitlines()) == 1, said.err
    assert "Traceback" not in said.err
    return said.err.strip()


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_command_explains_itself(pbpo: Run, words: list[str]) -> None:
    said = pbpo(*words, "--help")
    assert (said.status, said.err) == (0, "")
    assert "Usage:" in said.out


def test_a_study_is_begun_checked_created_opened_and_closed(pbpo: Run, tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    assert "holds an example" in pbpo("study", "init", folder).out
    check = pbpo("study", "check", folder)
    assert check.status == 2
    assert "recordings.csv:2: file: expected a video" in check.err

    own = write_own_study(tmp_path / "kettles")
    assert pbpo("study", "check", own).out.startswith("kettles: no fault found. Conditions: 2,")
    assert "created as a draft" in pbpo("study", "create", own).out
    opened = pbpo("study", "open", "kettles").out
    assert "doubt: study.yaml: its pages have not been previewed" in opened
    assert "participants enter at /s/kettles" in opened
    assert " open " in pbpo("study", "list").out.splitlines()[1]
    assert pbpo("study", "close", "kettles").out == "kettles is closed.\n"
    assert pbpo("study", "open", "kettles").status == 0


def test_a_study_is_paused_copied_and_deleted(pbpo: Run, tmp_path: Path) -> None:
    own = write_own_study(tmp_path / "kettles")
    pbpo("study", "create", own)
    assert "expected an open study" in mistake(pbpo("study", "pause", "kettles"))
    pbpo("study", "open", "kettles")
    assert "kettles is paused" in pbpo("study", "pause", "kettles").out
    assert "lets people in again" in pbpo("study", "resume", "kettles").out
    copy = tmp_path / "copy"
    assert "holds a copy of kettles" in pbpo("study", "clone", "kettles", copy).out
    assert pbpo("study", "check", copy).out.startswith("kettles-copy: no fault found.")
    assert "new or empty folder" in mistake(pbpo("study", "clone", "kettles", copy))
    assert "is open" in mistake(pbpo("study", "delete", "kettles", "--confirm", "kettles"))
    pbpo("study", "close", "kettles")
    assert "typed to delete it" in mistake(pbpo("study", "delete", "kettles"))
    said = pbpo("study", "delete", "kettles", "--confirm", "kettles")
    assert said.out == "kettles is deleted.\n"


def test_videos_that_some_browser_cannot_play_are_named_and_transcoded(
    pbpo: Run, tmp_path: Path
) -> None:
    own = write_own_study(tmp_path / "kettles")
    (own / "videos" / "a.mp4").unlink()
    write_video(own / "videos" / "a.avi", "mpeg4")
    table = own / "recordings.csv"
    table.write_text(table.read_text().replace("videos/a.mp4", "videos/a.avi"))
    assert "can be transcoded" in mistake(pbpo("study", "check", own))
    assert pbpo("study", "transcode", own).out.splitlines()[-2:][0] == "videos/a.mp4"
    assert pbpo("study", "check", own).status == 0
    assert (own / "videos" / "a.avi").is_file()


@pytest.mark.parametrize("name", ["waste-crane", "waste-crane-env2"])
def test_the_shipped_studies_are_without_fault(pbpo: Run, name: str) -> None:
    assert pbpo("study", "check", name).out.startswith(f"{name}: no fault found. Conditions: 3,")


def test_a_check_names_every_fault_of_a_folder_in_a_line_of_its_own(
    pbpo: Run, tmp_path: Path
) -> None:
    folder = write_own_study(tmp_path / "kettles")
    plan = (folder / "study.yaml").read_text(encoding="utf-8")
    plan = plan.replace("queries_per_trial: 4", "queries_per_trial: 0\nquerys: 3")
    (folder / "study.yaml").write_text(plan, encoding="utf-8")
    (folder / "recordings.csv").write_text(
        "speed,height,file,score\n"
        "0.1,1,videos/a.mp4,-3.5\n"
        "fast,1,videos/b.mp4,\n"
        "0.2,1,videos/a.mp4,\n"
        "0.3,1,videos/none.mp4,\n"
    )
    (folder / "texts" / "ja" / "debrief.md").unlink()

    said = pbpo("study", "check", folder)
    assert (said.status, said.out) == (2, "")
    lines = said.err.splitlines()
    places = {line.split(": ")[0] for line in lines}
    assert len(lines) == 6, said.err
    assert {"recordings.csv:3", "recordings.csv:4", "recordings.csv:5"} < places
    assert "texts/ja/debrief.md" in places
    assert sum(line.startswith("study.yaml:") for line in lines) == 2
    assert len(pbpo("study", "create", folder).err.splitlines()) == 6
    assert pbpo("study", "list").out.count("\n") == 1


MISTAKES: list[tuple[list[str], str]] = [
    (["study", "open", "nowhere"], "there is no study named 'nowhere'"),
    (["study", "close", "nowhere"], "there is no study named 'nowhere'"),
    (["export", "nowhere", "--out", "out"], "there is no study named 'nowhere'"),
    (["simulate", "nowhere"], "there is no study named 'nowhere'"),
    (["replay", "nowhere"], "there is no study named 'nowhere'"),
    (["study", "check", "nowhere"], "expected a study folder or a shipped study"),
    (["study", "create", "nowhere"], "expected a study folder or a shipped study"),
    (["study", "list", "--colour"], "--colour"),
    (["study", "dance"], "dance"),
    (["dance"], "dance"),
    (["export", "short"], "--out"),
    (["simulate", "short", "--sessions", "0"], "--sessions"),
    (["simulate", "short", "--evaluator", "moody"], "moody"),
    (["simulate", "short", "--spammers", "1"], "--people"),
    (["power", "--own-share", "2"], "--own-share"),
    (["simulate", "short", "--people", "2", "--spammers", "2"], "more than the 2"),
    (["media", "render", "--environment", "env3"], "env3"),
    (["serve", "--port", "99999"], "--port"),
    (["account", "token", "nobody@lab.example"], "there is no account"),
]


@pytest.mark.parametrize(("words", "sentence"), MISTAKES, ids=lambda value: str(value)[:40])
def test_a_mistake_is_one_line_and_exit_status_2(
    pbpo: Run, words: list[str], sentence: str
) -> None:
    assert sentence in mistake(pbpo(*words))


def test_mistakes_about_a_study_that_is_there(stocked: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    wrong_table = mistake(stocked("export", "short", "--out", out, "--table", "answers"))
    assert "expected tables among queries, trials, preferences" in wrong_table
    assert "'answers'" in wrong_table
    assert "pickle" in mistake(stocked("export", "short", "--out", out, "--format", "pickle"))
    assert "dream" in mistake(stocked("export", "short", "--out", out, "--mode", "dream"))
    assert not out.exists()
    again = write_study(tmp_path / "again")
    assert "the study 'short' is open" in mistake(stocked("study", "create", again))


def test_a_folder_or_a_file_in_the_way_is_named(pbpo: Run, tmp_path: Path) -> None:
    full = write_study(tmp_path / "full")
    assert "holds something already" in mistake(pbpo("study", "init", full))
    file = tmp_path / "file"
    file.write_text("")
    assert "got the file" in mistake(pbpo("study", "init", file))
    assert str(file) in mistake(pbpo("study", "list", "--data-dir", file))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("PBPO_RENDER_JOBS", "many"),
        ("PBPO_DATABASE_URL", "nonsense"),
        ("PBPO_DATABASE_URL", "x://y"),
    ],
)
def test_a_setting_that_is_not_understood_is_named(
    pbpo: Run, monkeypatch: pytest.MonkeyPatch, name: str, value: str
) -> None:
    monkeypatch.setenv(name, value)
    assert name in mistake(pbpo("study", "list"))


def test_a_database_that_gives_no_answer_is_said_in_a_line_without_its_password(
    pbpo: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PBPO_DATABASE_URL", "postgresql+psycopg://u:hunter2@127.0.0.1:1/pbpo")
    said = mistake(pbpo("study", "list"))
    assert said.startswith("pbpo: the database cannot be used: connection failed")
    assert "hunter2" not in said


def test_postgresql_without_its_driver_says_what_to_install(
    pbpo: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PBPO_DATABASE_URL", "postgresql+psycopg://u@127.0.0.1:1/pbpo")
    monkeypatch.setitem(sys.modules, "psycopg", None)
    said = mistake(pbpo("study", "list"))
    assert said.startswith("pbpo: PBPO_DATABASE_URL: expected psycopg to be installed")
    assert "pip install 'pbpo-studio[postgresql]'" in said


@pytest.mark.parametrize("name", ["PBPO_DATA_DIR", "PBPO_MEDIA_DIR", "PBPO_OWN_VIDEOS_DIR"])
def test_a_folder_that_cannot_be_made_is_named(
    pbpo: Run, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    # Nobody makes folders there, not even root.
    monkeypatch.setenv(name, "/proc/studio")
    said = mistake(pbpo("study", "list"))
    assert said.startswith("pbpo: expected a folder to write to, and /proc/studio cannot be made")


def test_closing_a_draft_is_refused(pbpo: Run, tmp_path: Path) -> None:
    pbpo("study", "create", write_study(tmp_path / "short"))
    assert "expected an open study" in mistake(pbpo("study", "close", "short"))


def test_simulated_sessions_are_walked_exported_and_replayed(stocked: Run, tmp_path: Path) -> None:
    said = stocked("simulate", "short", "--sessions", "2", "--evaluator", "uncertain")
    assert "2 simulated sessions of short were completed." in said.out

    out = tmp_path / "out"
    assert stocked("export", "short", "--out", out).status == 0
    assert pd.read_csv(out / "queries.csv").empty
    stocked("export", "short", "--out", out, "--mode", "simulated", "--mode", "live")
    assert {path.name for path in out.iterdir()} == {
        *(f"{table.name}.csv" for table in ZIPPED),
        "README.md",
    }
    queries = pd.read_csv(out / "queries.csv")
    assert len(queries) == 2 * 3 * 5
    assert set(queries["mode"]) == {"simulated"}
    # Seeds are drawn anew in each studio: whether somebody skips is up to them.
    assert {"left", "right"} <= set(queries["response"]) <= {"left", "right", "skip"}
    queries["shown_at"] = pd.to_datetime(queries["shown_at"])
    begun = queries.groupby(["session_id", "trial_index"])["shown_at"].first()
    assert (begun.groupby("session_id").diff().dropna() > pd.Timedelta(seconds=120)).all()

    only = tmp_path / "only"
    stocked("export", "short", "--out", only, "--table", "identities")
    assert [path.name for path in only.iterdir()] == ["identities.csv"]

    pooled = stocked("pool", "short", "--mode", "simulated", "--condition", "pbpo", "--out", only)
    assert "2 people together like Opening time" in pooled.out
    assert "no-skip:" not in pooled.out
    people = pd.read_csv(only / "people.csv")
    assert set(people["participant_id"]) == set(queries["participant_id"])
    assert set(pd.read_csv(only / "population.csv")["condition"]) == {"pbpo"}
    alone = stocked("pool", "short")
    assert "Expected answers of two people, no one has answered." in alone.out

    replayed = stocked("replay", "short")
    assert replayed.out == "6 trials, 30 queries replayed; 0 came out otherwise.\n"
    assert replayed.status == 0


def test_a_replay_finds_a_query_that_was_changed(stocked: Run, tmp_path: Path) -> None:
    stocked("simulate", "short", "--evaluator", "certain")
    database = Database(Settings(data_dir=tmp_path / "data").url)
    with database.write() as db:
        query = db.scalars(select(QueryRow).order_by(QueryRow.id).offset(4)).first()
        assert query is not None
        query.left_candidate = next(
            index
            for index in range(3)
            if index not in (query.left_candidate, query.right_candidate)
        )
    database.close()
    said = stocked("replay", "short")
    assert said.status == 1
    assert "query 4: stored" in said.out
    assert "3 trials, 15 queries replayed;" in said.out


def test_a_replay_finds_what_responses_do_not_teach(stocked: Run, tmp_path: Path) -> None:
    stocked("simulate", "short", "--evaluator", "certain")
    database = Database(Settings(data_dir=tmp_path / "data").url)
    with database.write() as db:
        taught = db.scalars(select(PreferenceRow).order_by(PreferenceRow.id)).first()
        acquired = db.scalars(select(Acquired).order_by(Acquired.id)).first()
        assert taught is not None
        assert acquired is not None
        as_taught = _told(taught)
        taught.winner, taught.loser = taught.loser, taught.winner
        as_turned = _told(taught)
        place, candidate = acquired.query_index, acquired.candidate
        acquired.candidate += 1
        # After the last query: no response can have taught it.
        beyond = Acquired(trial_id=acquired.trial_id, query_index=99, candidate=1)
        db.add(beyond)
    database.close()
    said = stocked("replay", "short")
    assert said.status == 1
    out = " ".join(said.out.split())
    asked = f"acquired after query {place}"
    assert f"{asked}: stored ({candidate + 1},), worked out ({candidate},)" in out
    # Who skips at first is taught nothing by the first query: which it is depends on the seed.
    assert f"preferences: stored ({as_turned},), worked out ({as_taught},)" in out
    assert "acquired after query 99: stored (1,), worked out (None,)" in out
    assert out.endswith("3 trials, 15 queries replayed; 3 came out otherwise.")


def _told(taught: PreferenceRow) -> tuple[int | str | None, ...]:
    return (
        *(taught.preference_index, taught.winner, taught.loser),
        *(taught.origin, taught.query_index, taught.drawn_from_query_index),
    )


def test_the_command_and_the_page_export_the_same_bytes(
    stocked: Run, tmp_path: Path, media_dir: Path
) -> None:
    stocked("simulate", "short")
    out = tmp_path / "out"
    stocked("export", "short", "--out", out, "--mode", "simulated")
    app = open_app(Settings(data_dir=tmp_path / "data", media_dir=media_dir), background=Idle(1))
    token = accounts.create_api_token(app, accounts.create(app, EMAIL, PASSWORD), "test")
    with Api(create_app(app=app)) as api:
        for path in out.glob("*.csv"):
            page = api.get(
                f"/api/v1/studies/short/export/{path.name}?mode=simulated",
                headers={"Authorization": f"Bearer {token}"},
            )
            assert page.content == path.read_bytes(), path.name
    app.close()


def test_a_study_without_scores_cannot_be_simulated(pbpo: Run, tmp_path: Path) -> None:
    pbpo("study", "create", write_own_study(tmp_path / "kettles"))
    pbpo("study", "open", "kettles")
    assert "expected a score for every recording" in mistake(pbpo("simulate", "kettles"))


def test_an_account_is_made_with_a_password_typed_twice_and_given_a_token(
    pbpo: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = iter([PASSWORD, PASSWORD, "short", "short", PASSWORD, PASSWORD])
    monkeypatch.setattr("getpass.getpass", lambda *_args, **_options: next(asked))
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert pbpo("account", "create", EMAIL).status == 0
    assert "at least 10 characters" in pbpo("account", "create", "bob@lab.example").err
    assert "has an account" in pbpo("account", "create", EMAIL).err
    assert len(pbpo("account", "token", EMAIL).out.strip()) == 43


def test_machines_are_added_listed_stopped_released_and_revoked(pbpo: Run, tmp_path: Path) -> None:
    folder = write_study(tmp_path / "robot", ROBOT_PLAN)
    assert pbpo("study", "create", folder).status == 0
    added = pbpo("machine", "add", "robot", "--name", "arm", "--address", "https://lab.example")
    token = added.out.strip()
    assert len(token) == 43
    assert f"--url https://lab.example --study robot --token {token}" in added.err
    assert "--w0 {w0} --w1 {w1} --out {video}" in added.err
    again = pbpo("machine", "add", "robot", "--name", "arm")
    assert (again.status, again.out) == (2, "")
    assert "revoke it first" in again.err
    assert "never" in pbpo("machine", "list", "robot").out
    assert pbpo("machine", "stop", "robot").status == 0
    assert "stopped since" in pbpo("machine", "list", "robot").out
    assert pbpo("machine", "release", "robot").status == 0
    assert "stopped since" not in pbpo("machine", "list", "robot").out
    assert pbpo("machine", "revoke", "robot", "--name", "arm").status == 0
    listed = pbpo("machine", "list", "robot").out
    assert "revoked" in listed
    assert token not in listed
    assert pbpo("machine", "revoke", "robot", "--name", "leg").status == 2
