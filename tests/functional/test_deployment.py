"""The files for Docker: what Docker and Compose would refuse, and what we promise of them."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from app.services.recordings.stores.factory import OWN_AT_PROXY, RENDERED_AT_PROXY
from app.services.runtime.errors import ConflictError
from app.services.runtime.settings import SECRETS_DIR, Settings
from app.storage.schema import migrate
from app.video.limits import PROBING, TRANSCODING
from tests.databases import PostgresServer

from .apart import server
from .test_commands import Run, mistake, pbpo

__all__ = ["pbpo", "server"]

ROOT = Path(__file__).parents[2]
PROGRAMS = Path(sys.executable).parent
VARIABLES = {f"PBPO_{name.upper()}" for name in Settings.model_fields} | {SECRETS_DIR}


def run(program: str, *words: str) -> None:
    done = subprocess.run(
        [str(PROGRAMS / program), *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def compose() -> dict[str, Any]:
    read: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text("utf-8"))
    return read


@pytest.fixture(scope="module")
def dockerfile() -> str:
    return (ROOT / "Dockerfile").read_text("utf-8")


def test_compose_reads_the_file() -> None:
    run(
        "check-jsonschema",
        *("--builtin-schema", "vendor.compose-spec"),
        str(ROOT / "docker-compose.yml"),
    )


def test_nothing_in_the_dockerfile_is_known_to_be_unwise() -> None:
    run("hadolint", "--failure-threshold", "style", str(ROOT / "Dockerfile"))


def test_every_service_has_as_few_rights_as_it_can(compose: dict[str, Any]) -> None:
    assert set(compose["services"]) == {"app", "worker", "backup", "postgres", "caddy"}
    for name, service in compose["services"].items():
        assert service["read_only"] is True, name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert "privileged" not in service, name
        assert service["healthcheck"]["test"], name
        assert re.fullmatch(r"[a-z-]+:\d[\w.-]*", service["image"]), name
        # Only what evaluators open can be reached from outside.
        assert ("ports" in service) == (name == "caddy")


def test_no_service_takes_the_memory_of_the_others(compose: dict[str, Any]) -> None:
    units = {"m": 1 << 20, "g": 1 << 30}
    limits = {}
    for name, service in compose["services"].items():
        said = service["mem_limit"]
        limits[name] = int(said[:-1]) * units[said[-1]]
        # Nor does it swap instead.
        assert service["memswap_limit"] == said, name
    # What a decoder of videos may take has to fit beside the process that began it.
    for name in ("app", "worker"):
        assert limits[name] >= PROBING.memory_bytes + (1 << 29), name
        assert limits[name] >= TRANSCODING.memory_bytes + (1 << 29), name
    assert sum(limits.values()) <= 10 << 30


def test_what_a_service_keeps_is_in_a_named_volume(compose: dict[str, Any]) -> None:
    for service in compose["services"].values():
        for volume in service["volumes"]:
            source = volume.split(":")[0]
            assert source in compose["volumes"] or volume.endswith("Caddyfile:ro"), volume


def test_caddy_sees_videos_and_nothing_else_of_the_studio(
    compose: dict[str, Any], dockerfile: str
) -> None:
    mounted = {
        name: dict(volume.split(":", 1) for volume in service["volumes"])
        for name, service in compose["services"].items()
    }
    shared = mounted["caddy"].keys() & mounted["app"].keys()
    assert {name: mounted["caddy"][name] for name in shared} == {
        "own_videos": f"/srv{OWN_AT_PROXY}:ro",
        "media": f"/srv{RENDERED_AT_PROXY}:ro",
    }
    assert f"PBPO_OWN_VIDEOS_DIR={mounted['app']['own_videos']} " in dockerfile
    assert f"PBPO_MEDIA_DIR={mounted['app']['media']} " in dockerfile


def test_what_is_uploaded_does_not_lie_in_memory(compose: dict[str, Any]) -> None:
    app = compose["services"]["app"]
    folder = app["environment"]["TMPDIR"]
    assert folder in {volume.split(":")[1] for volume in app["volumes"]}
    assert folder not in app["tmpfs"]


def test_secrets_come_from_files_alone(compose: dict[str, Any], dockerfile: str) -> None:
    secret = {"PBPO_DATABASE_URL", "PBPO_METRICS_TOKEN", "POSTGRES_PASSWORD"}
    for service in compose["services"].values():
        assert not secret & service["environment"].keys()
    assert not [name for name in secret if name in dockerfile]
    assert "/secrets/" in (ROOT / ".gitignore").read_text().splitlines()
    named = {name.upper() for name in compose["secrets"] if name.startswith("pbpo_")}
    assert named <= VARIABLES


def test_every_setting_that_is_named_exists(compose: dict[str, Any], dockerfile: str) -> None:
    named = set(re.findall(r"PBPO_[A-Z_]+", dockerfile))
    for service in compose["services"].values():
        named |= {name for name in service["environment"] if name.startswith("PBPO_")}
    assert len(named) >= 7
    assert named - {"PBPO_DOMAIN"} <= VARIABLES


def test_the_image_has_what_the_program_reads(dockerfile: str) -> None:
    copied = {
        word.rstrip("/")
        for line in re.findall(r"^COPY (?!--from)(.+)$", dockerfile, re.MULTILINE)
        for word in line.split()[:-1]
    }
    assert all((ROOT / name).exists() for name in copied)
    assert {"app", "migrations", "templates", "static"} <= copied
    let_in = (ROOT / ".dockerignore").read_text().splitlines()
    assert {f"!{name}" for name in copied} <= set(let_in)
    assert re.search(r"^USER [1-9]\d*:[1-9]\d*$", dockerfile, re.MULTILINE)


def test_the_recipe_for_a_restore_fits_the_compose_file(
    compose: dict[str, Any], dockerfile: str, pbpo: Run
) -> None:
    text = (ROOT / "docs" / "operations.md").read_text("utf-8")
    recipe = text.partition("<!-- recipe:")[2].partition("```sh\n")[2].partition("```")[0]
    lines = recipe.replace("\\\n", " ").splitlines()
    words = shlex.split(next(line for line in lines if " restore " in line))
    mounted = {}
    for volume in (words[at + 1] for at, word in enumerate(words) if word == "--volume"):
        name, folder, mode = volume.split(":")
        # The volumes of the project as it was, which are only read.
        assert name.removeprefix(f"{compose['name']}_") in compose["volumes"]
        assert mode == "ro"
        mounted[folder] = name.removeprefix(f"{compose['name']}_")
    service, *command = words[words.index("app") :]
    its_own = {volume.split(":")[1] for volume in compose["services"][service]["volumes"]}
    # What it writes to is new; the place of the data folder is not taken by what it reads.
    assert not its_own & mounted.keys()
    _, backup, _, ledger = command
    assert mounted[str(Path(backup).parent)] == "backups"
    assert mounted[str(Path(ledger).parent)] == "ledger"
    written = re.search(r"/backups/(pbpo-)\$\$\(date -u \+(\S+)\)\.zip", str(compose))
    assert written is not None
    pattern = re.sub(r"%(\w)", lambda part: r"\d{4}" if part[1] == "Y" else r"\d\d", written[2])
    assert re.fullmatch(f"pbpo-{pattern}.zip", Path(backup).name)
    kept = re.search(r"PBPO_DELETIONS_FILE=/ledger/(\S+)", dockerfile)
    assert kept is not None
    assert kept[1] == Path(ledger).name
    # It is a command of ours: only its files are missing here.
    assert "there is no such file" in mistake(pbpo(*command))


def test_settings_are_read_from_files_of_secrets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    token = "a-token-of-thirty-two-characters!"
    (tmp_path / "pbpo_metrics_token").write_text(f"{token}\n")
    (tmp_path / "pbpo_render_jobs").write_text("7\n")
    monkeypatch.setenv(SECRETS_DIR, str(tmp_path))
    settings = Settings()
    assert settings.metrics_token is not None
    assert settings.metrics_token.get_secret_value() == token
    assert settings.render_jobs == 7
    assert token not in repr(settings)
    monkeypatch.setenv("PBPO_RENDER_JOBS", "3")
    assert Settings().render_jobs == 3


def test_a_folder_of_secrets_that_is_not_there_is_said(
    pbpo: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(SECRETS_DIR, str(tmp_path / "none"))
    with pytest.raises(ConflictError, match="expected a folder"):
        Settings()
    assert SECRETS_DIR in mistake(pbpo("study", "list"))


@pytest.mark.postgresql
def test_servers_that_start_at_once_migrate_once(server: PostgresServer, tmp_path: Path) -> None:
    url = server.empty("begun_at_once")
    code = f"from app.storage.schema import migrate; migrate({url!r})"
    begun = [subprocess.Popen([sys.executable, "-c", code], cwd=ROOT) for _ in range(3)]
    assert [process.wait(120) for process in begun] == [0, 0, 0]
    migrate(url)
