"""An experimenter at their desk: signed in, and sending the forms of their own pages."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path

import httpx

from app.services.accounts import accounts
from app.services.context import AppContext

from .client import Api


class Desk:
    """One signed-in browser. `post` sends a form with the token of the pages."""

    def __init__(self, client: Api, app: AppContext, email: str, role: accounts.Role) -> None:
        self.account = accounts.create(app, email, "correct horse battery", role)
        self.client = client
        self._sign_in = accounts.sign_in(app, email, "correct horse battery")
        self._be()
        page = client.get("/studies").text
        found = re.search(r'name="csrf_token" value="([0-9a-f]+)"', page)
        assert found, page
        self.csrf = found[1]

    def get(self, path: str) -> httpx.Response:
        self._be()
        return self.client.get(path)

    def post(self, path: str, **data: str | list[str]) -> httpx.Response:
        self._be()
        return self.client.post(path, data={"csrf_token": self.csrf, **data})

    def send(self, path: str, files: Mapping[str, bytes], **data: str) -> httpx.Response:
        """Send files by a form of several parts."""
        self._be()
        parts = [("files", (name, io.BytesIO(content))) for name, content in files.items()]
        form = {"csrf_token": self.csrf, **data}
        return self.client.post(path, data=form, files=parts or {"files": ("", b"")})

    def begin(self, files: Mapping[str, bytes], name: str = "") -> str:
        """Begin a study from these files: the address of its page."""
        answer = self.send("/drafts", files, name=name)
        assert answer.status_code == 303, answer.text
        return answer.headers["location"]

    def _be(self) -> None:
        self.client.cookies.clear()
        self.client.cookies.set("pbpo_sign_in", self._sign_in)


def zipped(folder: Path, around: str = "") -> bytes:
    """The folder as a zip, as a system would make it, within a folder `around` everything."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                archive.write(path, f"{around}{path.relative_to(folder).as_posix()}")
    return packed.getvalue()
