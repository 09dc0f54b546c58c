"""The proxies whose configuration is shipped in deploy/, each in a process of its own."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from urllib.parse import urlsplit

import httpx

from tests.ports import free_port

from .started import Started

ROOT = Path(__file__).parents[2]


class Proxy(Started):
    """A proxy on a free port in front of a server. `url` is where it answers.

    above: the folder in which it finds `videos/own` and `videos/rendered`.
    """

    #: The path below which the studio is served.
    root = ""

    def __init__(self, server: str, above: Path, folder: Path) -> None:
        folder.mkdir()
        self.url = f"http://127.0.0.1:{free_port()}"
        words, environment = self.command(urlsplit(server).netloc, above, folder)
        super().__init__(words, folder / "proxy.log", **environment)

    def command(self, server: str, above: Path, folder: Path) -> tuple[list[str], dict[str, str]]:
        """What starts it, and with which variables."""
        raise NotImplementedError

    def is_ready(self) -> bool:
        try:
            return httpx.get(f"{self.url}{self.root}/healthz", verify=False).status_code == 200
        except httpx.TransportError:
            return False


class Caddy(Proxy):
    """With deploy/caddy/Caddyfile as it is; without TLS, since its site is named so."""

    def command(self, server: str, above: Path, folder: Path) -> tuple[list[str], dict[str, str]]:
        host, _, port = server.partition(":")
        file = ROOT / "deploy" / "caddy" / "Caddyfile"
        return [_program("caddy"), "run", "--config", str(file), "--adapter", "caddyfile"], {
            "PBPO_DOMAIN": self.url,
            "PBPO_ROOT_PATH": self.root,
            "PBPO_APP": host,
            "PBPO_APP_PORT": port,
            "PBPO_VIDEOS_ABOVE": str(above),
            # Its own port for commands may be taken by another one.
            "CADDY_ADMIN": f"127.0.0.1:{free_port()}",
            "XDG_CONFIG_HOME": str(folder),
            "XDG_DATA_HOME": str(folder),
        }


class Nginx(Proxy):
    """With the files of deploy/nginx, but for the address and the folder named there."""

    def command(self, server: str, above: Path, folder: Path) -> tuple[list[str], dict[str, str]]:
        shipped = (ROOT / "deploy" / "nginx" / "pbpo.conf").read_text("utf-8")
        for said, here in (("127.0.0.1:8000", server), ("root /srv;", f"root {above};")):
            assert shipped.count(said) == 1, said
            shipped = shipped.replace(said, here)
        (folder / "pbpo.conf").write_text(shipped)
        held = "".join(
            f"{kind}_temp_path {folder}/{kind};"
            for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
        )
        limit = ROOT / "deploy" / "nginx" / "sign_in_limit.conf"
        file = folder / "nginx.conf"
        file.write_text(
            f"daemon off; master_process off; pid {folder}/pid; error_log stderr; events {{}}"
            f" http {{ access_log off; {held} include {limit}; server {{"
            f" listen {urlsplit(self.url).netloc}; include {folder}/pbpo.conf; }} }}"
        )
        return [_program("nginx"), "-c", str(file), "-p", str(folder)], {}


def _program(name: str) -> str:
    # Debian keeps servers where only root looks for commands.
    found = shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin")
    assert found, f"expected {name} to be installed, as .ci/run does, and it is not"
    return found
