"""`pbpo serve` over the demo's data, and over settings that are less safe than they could be."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.services.accounts import accounts, administration, audit_log
from app.services.accounts.accounts import Role
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.monitoring import startup_checks
from app.services.runtime.errors import ConflictError
from app.services.runtime.settings import Settings
from app.services.studies import demo
from tests.conftest import Idle

from .conftest import EMAIL, PASSWORD
from .served import Served
from .test_commands import Run, mistake, pbpo

__all__ = ["pbpo"]

HOST = "127.0.0.1"


def test_the_demos_account_is_not_served_until_it_is_disabled(
    pbpo: Run, tmp_path: Path, media_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data_dir = tmp_path / "data"
    app = open_app(Settings(data_dir=data_dir, media_dir=media_dir), background=Idle(1))
    access = demo.prepare(app, "http://127.0.0.1:8000")
    app.close()

    said = mistake(pbpo("serve", "--port", 0))
    assert f"{demo.EMAIL} can sign in with the password in access.json" in said
    assert access.password not in said
    assert "the last one" in mistake(pbpo("account", "disable", demo.EMAIL))

    monkeypatch.setattr("typer.prompt", lambda *_, **__: PASSWORD)
    assert pbpo("account", "create", EMAIL, "--role", "admin").status == 0
    assert pbpo("account", "disable", demo.EMAIL).status == 0
    with Served("serve", data_dir, media_dir) as server:
        assert "access.json holds the demo's password" in server.output

    # The demo itself may be run over the same data again, and works.
    app = open_app(Settings(data_dir=data_dir, media_dir=media_dir), background=Idle(1))
    again = demo.prepare(app, "http://127.0.0.1:8000")
    assert accounts.by_sign_in(app, accounts.sign_in(app, again.email, again.password))
    app.close()


@pytest.mark.parametrize(
    ("host", "secure", "expected"),
    [
        ("127.0.0.1", False, 0),
        ("::1", False, 0),
        ("localhost", False, 0),
        ("0.0.0.0", False, 1),
        ("lab.example", False, 1),
        ("0.0.0.0", True, 0),
    ],
)
def test_cookies_over_plain_http_are_said_where_others_can_listen(
    app: AppContext, tmp_path: Path, media_dir: Path, host: str, secure: bool, expected: int
) -> None:
    settings = Settings(data_dir=tmp_path / "new", media_dir=media_dir, secure_cookies=secure)
    opened = open_app(settings, background=Idle(1))
    said = list(startup_checks.unsafe_settings(opened, host))
    opened.close()
    assert len(said) == expected, said
    assert all("PBPO_SECURE_COOKIES=true" in sentence for sentence in said)


def test_in_production_what_is_less_safe_is_refused(
    pbpo: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PBPO_PRODUCTION", "true")
    said = mistake(pbpo("serve", "--port", 0))
    assert "PBPO_SECURE_COOKIES=true" in said

    monkeypatch.setenv("PBPO_SECURE_COOKIES", "true")
    monkeypatch.setenv("PBPO_MEDIA_DIR", str(tmp_path / "media"))
    data, media = tmp_path / "data", tmp_path / "media"
    media.mkdir()
    data.chmod(0o755)
    media.chmod(0o777)
    ledger = data / "deletions.log"
    ledger.touch()
    ledger.chmod(0o644)
    (data / "access.json").touch()
    said = mistake(pbpo("serve", "--port", 0))
    for advice in (
        "set PBPO_PUBLIC_URL",
        f"chmod 700 {data}",
        f"chmod o-w {media}",
        f"chmod 600 {ledger}",
        "delete it.",
    ):
        assert advice in said


@pytest.mark.parametrize(
    "proxies",
    ["*", "10.0.0.0/8, lab.example", "10.0.0.1/8", "0.0.0.0/0", "::1, ::/0", "128.0.0.0/1"],
)
def test_proxies_are_named_by_their_addresses(
    pbpo: Run, monkeypatch: pytest.MonkeyPatch, proxies: str
) -> None:
    monkeypatch.setenv("PBPO_TRUSTED_PROXIES", proxies)
    said = mistake(pbpo("serve", "--port", 0))
    assert "PBPO_TRUSTED_PROXIES" in said
    assert "expected addresses or networks" in said


@pytest.mark.parametrize(
    ("address", "host"),
    [
        ("lab:secret@db.lab.example/pbpo", "db.lab.example"),
        ("lab:secret@192.168.1.7/pbpo?sslmode=prefer", "192.168.1.7"),
        ("lab:secret@[2001:db8::7]/pbpo", "2001:db8::7"),
        ("lab:secret@/pbpo?host=localhost:5432&host=db.lab.example:5432", "db.lab.example"),
        ("lab:secret@db.lab.example/pbpo?sslmode=require", None),
        ("lab:secret@db.lab.example/pbpo?sslmode=verify-full", None),
        ("lab:secret@127.0.0.1/pbpo", None),
        ("lab:secret@[::1]/pbpo", None),
        # As containers call each other on a network of their own.
        ("lab:secret@postgres/pbpo", None),
        ("lab:secret@postgres:5432/pbpo", None),
        ("/pbpo?host=/var/run/postgresql", None),
    ],
)
def test_a_database_far_away_is_spoken_to_over_tls(
    app: AppContext, monkeypatch: pytest.MonkeyPatch, address: str, host: str | None
) -> None:
    monkeypatch.delenv("PGSSLMODE", raising=False)
    app.settings.data_dir.chmod(0o700)
    url = f"postgresql+psycopg://{address}"
    said = said_of(app, Settings(data_dir=app.settings.data_dir, database_url=url))
    expected = [] if host is None else [f"Answers would go to and from {host} in the clear"]
    assert [sentence.partition(",")[0] for sentence in said] == expected
    assert "secret" not in str(said)


@pytest.mark.parametrize(
    ("folder_mode", "mode", "is_said"),
    [(0o755, 0o644, True), (0o755, 0o600, False), (0o700, 0o644, False)],
)
def test_a_database_outside_of_the_data_folder_is_for_its_owner_alone(
    app: AppContext, tmp_path: Path, folder_mode: int, mode: int, is_said: bool
) -> None:
    app.settings.data_dir.chmod(0o700)
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    file = folder / "answers.sqlite3"
    file.touch()
    file.chmod(mode)
    folder.chmod(folder_mode)
    settings = Settings(data_dir=app.settings.data_dir, database_url=f"sqlite:///{file}")
    assert [f"chmod 600 {file}*" in said for said in said_of(app, settings)] == [True] * is_said


@pytest.mark.parametrize(("user", "is_said"), [(0, True), (10001, False)])
def test_in_production_nothing_is_served_as_root(
    app: AppContext, monkeypatch: pytest.MonkeyPatch, user: int, is_said: bool
) -> None:
    app.settings.data_dir.chmod(0o700)
    monkeypatch.setattr("os.geteuid", lambda: user)
    secure = app.settings.model_copy(update={"secure_cookies": True})
    production = secure.model_copy(
        update={"production": True, "public_url": "https://studies.lab.example"}
    )
    said = said_of(app, production)
    assert ["runs as root" in sentence for sentence in said] == [True] * is_said
    assert said_of(app, secure) == []


def said_of(app: AppContext, settings: Settings) -> list[str]:
    """What is said of these settings; the studio's are others again afterwards."""
    before = app.settings
    object.__setattr__(app, "settings", settings)
    said = list(startup_checks.unsafe_settings(app, HOST))
    object.__setattr__(app, "settings", before)
    return said


@pytest.mark.sqlite
def test_several_workers_are_refused_on_sqlite(pbpo: Run) -> None:
    said = mistake(pbpo("serve", "--workers", 2, "--port", 0))
    assert "expected one worker on SQLite" in said


def test_a_data_folder_that_others_can_read_is_said(app: AppContext) -> None:
    folder = app.settings.data_dir
    folder.chmod(0o750)
    assert [
        f"chmod 700 {folder}" in said for said in startup_checks.unsafe_settings(app, "::1")
    ] == [True]
    folder.chmod(0o700)
    assert list(startup_checks.unsafe_settings(app, "::1")) == []


def test_a_variable_that_is_nearly_a_setting_is_said(
    app: AppContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    app.settings.data_dir.chmod(0o700)
    monkeypatch.setenv("PBPO_TEST_MEDIA_DIR", "/of/tests")
    monkeypatch.setenv("PBPO_DOMAIN", "of.the.proxy")
    assert list(startup_checks.unsafe_settings(app, HOST)) == []
    monkeypatch.setenv("PBPO_PRODUCTOIN", "true")
    assert list(startup_checks.unsafe_settings(app, HOST)) == [
        "PBPO_PRODUCTOIN is no setting, and has no effect: PBPO_PRODUCTION may be meant."
    ]


def test_only_the_demos_account_is_refused(app: AppContext) -> None:
    accounts.create(app, EMAIL, PASSWORD)
    startup_checks.require_safe(app, HOST)
    accounts.create(app, demo.EMAIL, PASSWORD, Role.REVIEWER)
    with pytest.raises(ConflictError, match="expected no demo account"):
        startup_checks.require_safe(app, HOST)
    administration.disable(app, demo.EMAIL, audit_log.COMMAND_LINE)
    startup_checks.require_safe(app, HOST)
