"""What can be set from outside, by `PBPO_...` variables or by the commands' options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class Settings(BaseSettings):
    """Where things are kept and how the server presents itself."""

    model_config = SettingsConfigDict(env_prefix="PBPO_", frozen=True, extra="ignore")

    data_dir: Annotated[
        Path, Field(description="The SQLite file, access.json and the videos of own studies.")
    ] = Path("data")
    database_url: Annotated[
        str, Field(description="Default: a SQLite file in the data folder.")
    ] = ""
    media_dir: Annotated[
        Path, Field(description="Rendered recordings, named by content, shared by all studies.")
    ] = Path("media")
    secure_cookies: Annotated[
        bool, Field(description="Send cookies over HTTPS only. Set it wherever TLS is.")
    ] = False
    render_jobs: Annotated[
        int, Field(ge=1, le=64, description="Videos rendered at the same time.")
    ] = 2

    @property
    def url(self) -> str:
        return self.database_url or f"sqlite:///{self.data_dir.resolve() / 'pbpo.sqlite3'}"

    @property
    def uploads_dir(self) -> Path:
        return self.data_dir / "uploads"
