"""Settings, from `PBPO_...` environment variables, files of secrets, or options of the commands."""

from __future__ import annotations

import ipaddress
import os
import re
from collections.abc import Iterator
from difflib import get_close_matches
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated
from urllib.parse import urlsplit

from pydantic import Field, SecretStr, ValidationError, ValidationInfo, field_validator
from pydantic_settings import (
    BaseSettings,
    PydanticBaseSettingsSource,
    SecretsSettingsSource,
    SettingsConfigDict,
)
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError

from .errors import ConflictError

DATABASES = ("sqlite", "postgresql")
#: Name of the SQLite file in the data folder.
DATABASE_FILE = "pbpo.sqlite3"
_PREFIX = "PBPO_"
#: Similarity, from 0 to 1, above which an unknown variable counts as a misspelt setting:
#: PBPO_DATABASE does, PBPO_TEST_MEDIA_DIR does not.
_NEARLY = 0.86
#: Prefix lengths of the widest private networks by IP version: 10.0.0.0/8 and fc00::/7.
_WIDEST = {4: 8, 6: 7}
#: A path of parts that no browser and no proxy changes, and that lead to no folder above.
_ROOT_PATH = re.compile(r"(/[A-Za-z0-9_-][A-Za-z0-9._-]*)+")
#: Variable with the path of a folder that has a file per setting, such as `pbpo_database_url`, as
#: containers provide secrets. Whoever may inspect a container sees its environment variables.
SECRETS_DIR = "PBPO_SECRETS_DIR"


class Settings(BaseSettings):
    """All settings of a server or command."""

    model_config = SettingsConfigDict(env_prefix=_PREFIX, frozen=True, extra="ignore")

    data_dir: Annotated[
        Path, Field(description="The SQLite file, access.json and the videos of own studies.")
    ] = Path("data")
    database_url: Annotated[
        str, Field(description="URL of a database. Default: a SQLite file in the data folder.")
    ] = ""
    media_dir: Annotated[
        Path, Field(description="Rendered recordings, named by content, shared by all studies.")
    ] = Path("media")
    own_videos_dir: Annotated[
        Path | None,
        Field(description="The videos of own studies. Default: uploads in the data folder."),
    ] = None
    recordings_url: Annotated[
        str,
        Field(
            description="s3://bucket/prefix: an S3-compatible store for all recordings. Default:"
            " the two folders above."
        ),
    ] = ""
    s3_endpoint: Annotated[
        str, Field(description="URL of that store's API. Default: that of Amazon.")
    ] = ""
    s3_public_endpoint: Annotated[
        str, Field(description="The same for browsers, where they reach it under another name.")
    ] = ""
    proxy_sends_videos: Annotated[
        bool,
        Field(
            description="The proxy in front sends videos by itself, as X-Accel-Redirect tells it."
            " Needs PBPO_OWN_VIDEOS_DIR and PBPO_MEDIA_DIR outside the data folder."
        ),
    ] = False
    public_url: Annotated[
        str,
        Field(
            description="The address at which people reach the studio, such as"
            " https://studies.lab.example: what links that go out begin with. Default: what the"
            " browser that asks has asked for."
        ),
    ] = ""
    root_path: Annotated[
        str,
        Field(
            description="The path below which the studio is served, such as /pbpo for"
            " https://lab.example/pbpo/. Default: the host is the studio's alone."
        ),
    ] = ""
    prolific_keys: Annotated[
        str,
        Field(
            description="Where the public keys (JWKS) are that Prolific signs links with, for"
            " studies with signed_links: an https address, or a file."
        ),
    ] = "https://api.prolific.com/.well-known/study/jwks.json"
    secure_cookies: Annotated[
        bool,
        Field(
            description="Send cookies over HTTPS only, and tell browsers to come by nothing else"
            " for a year. Set it wherever TLS is."
        ),
    ] = False
    render_jobs: Annotated[
        int, Field(ge=1, le=64, description="Videos rendered at the same time.")
    ] = 2
    workers_apart: Annotated[
        bool,
        Field(
            description="Leave rendering, jobs and retention to `pbpo worker` processes. Needs"
            " PostgreSQL; the same for servers and workers."
        ),
    ] = False

    upload_limit_mb: Annotated[
        int, Field(ge=1, description="What a study made in the browser may take, in megabytes.")
    ] = 4000

    recording_limit_mb: Annotated[
        int, Field(ge=1, description="What one recording of a machine may take, in megabytes.")
    ] = 1000

    drafts_per_account: Annotated[
        int, Field(ge=1, description="Studies that one account may be making at a time.")
    ] = 20

    account_limit_mb: Annotated[
        int,
        Field(
            ge=1,
            description="What all studies that one account is making may take together, in"
            " megabytes.",
        ),
    ] = 12000

    keep_free_gb: Annotated[
        float,
        Field(
            ge=0,
            description="Gigabytes of a disk that stay free, or a tenth of the disk if that is"
            " less: uploads, new studies, jobs and backups that would take them are refused. 0:"
            " none.",
        ),
    ] = 5.0

    drafts_kept_days: Annotated[
        int,
        Field(
            ge=1,
            description="Days without a change after which a study that is being made in the"
            " browser is thrown away.",
        ),
    ] = 60

    begun_per_hour: Annotated[
        int,
        Field(
            ge=1,
            description="Sessions of one study that may begin within an hour without an answer to"
            " a pair; twice as many for who comes with a platform's id. Beyond that newcomers are"
            " asked to come back later.",
        ),
    ] = 2000

    chromium: Annotated[
        str, Field(description="A Chromium, for pictures of pages. Default: one that is found.")
    ] = ""

    metrics_token: Annotated[
        SecretStr | None,
        Field(
            min_length=32,
            description="Bearer token for /metrics, at least 32 characters. Default: no /metrics.",
        ),
    ] = None

    deletions_file: Annotated[
        Path | None,
        Field(
            description="The ledger of deletions, best on another disk than the database."
            " Default: deletions.log in the data folder."
        ),
    ] = None

    trusted_proxies: Annotated[
        str,
        Field(
            description="Addresses or networks, with commas between, of the proxies whose word on"
            " HTTPS is taken."
        ),
    ] = "127.0.0.1,::1"
    production: Annotated[
        bool,
        Field(description="Refuse to serve with any setting that is less safe than it could be."),
    ] = False

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Order of precedence: arguments, variables, files of secrets. Raises ConflictError."""
        folder = os.environ.get(SECRETS_DIR)
        if folder is None:
            return init_settings, env_settings
        if not Path(folder).is_dir():
            raise ConflictError(f"{SECRETS_DIR}: expected a folder, and {folder} is none")
        return init_settings, env_settings, SecretsSettingsSource(settings_cls, folder)

    @field_validator("trusted_proxies")
    @classmethod
    def _known_proxies(cls, value: str) -> str:
        for part in filter(None, map(str.strip, value.split(","))):
            try:
                network = ipaddress.ip_network(part)
                is_named = network.prefixlen >= _WIDEST[network.version]
            except ValueError:
                is_named = False
            if not is_named:
                raise ValueError(
                    "expected addresses or networks such as 10.0.0.0/8, and none that is wider, got"
                    f" {part!r}: whoever may say that a request came over HTTPS has to be named"
                )
        return value

    @field_validator("public_url")
    @classmethod
    def _known_address(cls, url: str) -> str:
        url = url.rstrip("/")
        if url and not re.fullmatch(r"https?://([A-Za-z0-9.-]+|\[[0-9a-fA-F:.]+\])(:\d+)?", url):
            raise ValueError(
                "expected a URL such as https://studies.lab.example, without a path (that is"
                f" PBPO_ROOT_PATH), got {url[:100]!r}"
            )
        return url

    @field_validator("root_path")
    @classmethod
    def _known_root(cls, path: str) -> str:
        if path and not _ROOT_PATH.fullmatch(path):
            repaired = "/" + "/".join(part for part in urlsplit(path).path.split("/") if part)
            instead = f": set {repaired}" if _ROOT_PATH.fullmatch(repaired) else ""
            raise ValueError(
                "expected a path such as /pbpo, which begins with a slash and does not end with"
                f" one, of letters, digits, '-', '_' and '.', got {path[:100]!r}{instead}"
            )
        return path

    @field_validator("database_url")
    @classmethod
    def _known_database(cls, url: str) -> str:
        # The URL may hold a password: it is not repeated in the message.
        try:
            backend = make_url(url).get_backend_name() if url else "sqlite"
        except ArgumentError:
            backend = ""
        if backend not in DATABASES:
            raise ValueError(f"expected the URL of a database of {' or '.join(DATABASES)}")
        if backend == "postgresql" and find_spec("psycopg") is None:
            raise ValueError(
                "expected psycopg to be installed, which PostgreSQL needs, and it is not:"
                " pip install 'pbpo-studio[postgresql]'"
            )
        return url

    @field_validator("workers_apart")
    @classmethod
    def _workers_share_a_server(cls, apart: bool, info: ValidationInfo) -> bool:
        # An invalid URL is missing here; it is reported by its own validator.
        url = info.data.get("database_url", "postgresql://")
        if apart and (not url or make_url(url).get_backend_name() == "sqlite"):
            raise ValueError(
                "expected PostgreSQL (PBPO_DATABASE_URL) where work is left to workers, got SQLite,"
                " which has one writer at a time"
            )
        return apart

    @field_validator("recordings_url")
    @classmethod
    def _known_store(cls, url: str) -> str:
        # The value is not repeated in the message: it may contain a key, and messages are logged.
        if url and not re.fullmatch(r"s3://[a-z0-9][a-z0-9.-]{1,61}[a-z0-9](/[\w.-]+)*/?", url):
            raise ValueError("expected s3://bucket or s3://bucket/prefix, without keys")
        return url

    @field_validator("s3_endpoint", "s3_public_endpoint")
    @classmethod
    def _known_endpoint(cls, url: str) -> str:
        if url and not re.fullmatch(r"https?://[A-Za-z0-9.-]+(:\d+)?/?", url):
            raise ValueError(
                "expected a URL such as https://s3.lab.example, without keys or a path"
            )
        return url

    @field_validator("own_videos_dir")
    @classmethod
    def _videos_apart_from_answers(cls, folder: Path | None, info: ValidationInfo) -> Path | None:
        # An invalid folder is missing here; it is reported by its own validator.
        data = info.data.get("data_dir")
        if folder is not None and data is not None and _one_holds_the_other(folder, data):
            raise ValueError(
                f"expected a folder apart from {data}, which has the answers, got {folder}"
            )
        return folder

    @field_validator("proxy_sends_videos")
    @classmethod
    def _proxies_read_videos_alone(cls, sends: bool, info: ValidationInfo) -> bool:
        if not sends or not {"data_dir", "own_videos_dir", "media_dir"} <= info.data.keys():
            return sends
        if info.data.get("recordings_url"):
            raise ValueError(
                "expected videos in folders, where the proxy reads them, got PBPO_RECORDINGS_URL:"
                " browsers get them from that store without the proxy"
            )
        data, media = info.data["data_dir"], info.data["media_dir"]
        if info.data["own_videos_dir"] is None or _one_holds_the_other(media, data):
            raise ValueError(
                "expected PBPO_OWN_VIDEOS_DIR and PBPO_MEDIA_DIR to be folders apart from"
                f" {data}, which has the answers, since the proxy has to read them"
            )
        return sends

    @property
    def url(self) -> str:
        """URL of the database in use."""
        return self.database_url or f"sqlite:///{self.data_dir.resolve() / DATABASE_FILE}"

    @property
    def public_base(self) -> str:
        """What public links begin with, the path included; empty without PBPO_PUBLIC_URL."""
        return self.public_url and self.public_url + self.root_path

    @property
    def deletion_log_path(self) -> Path:
        """Path of the deletion log."""
        return self.deletions_file or self.data_dir / "deletions.log"

    @property
    def uploads_dir(self) -> Path:
        """Folder of the files of study drafts."""
        return self.data_dir / "uploads"

    @property
    def own_videos(self) -> Path:
        """Folder of studies' own videos; those of drafts are in `uploads_dir`."""
        return self.own_videos_dir or self.uploads_dir


def _one_holds_the_other(one: Path, other: Path) -> bool:
    one, other = one.resolve(), other.resolve()
    return one.is_relative_to(other) or other.is_relative_to(one)


def misspelt_settings() -> Iterator[tuple[str, str]]:
    """Environment variables that look like a misspelt setting, each with the setting's name."""
    known = {f"{_PREFIX}{name}".upper() for name in Settings.model_fields} | {SECRETS_DIR}
    for name in sorted(os.environ):
        if name.upper().startswith(_PREFIX) and name.upper() not in known:
            for meant in get_close_matches(name.upper(), known, n=1, cutoff=_NEARLY):
                yield name, meant


def settings_faults(error: ValidationError) -> str:
    """The validation errors of settings in one line, by the names of their variables."""
    return "; ".join(
        f"{_PREFIX}{'.'.join(map(str, fault['loc'])).upper()}: {_said(fault['msg'])}"
        for fault in error.errors(include_url=False, include_input=False)
    )


def _said(message: str) -> str:
    # Pydantic puts this prefix before the messages of our own validators.
    return message.removeprefix("Value error, ")
