"""Files of others that pages load: each is the one that the manifest says."""

from __future__ import annotations

import hashlib
import json

from app.web.http.templating import STATIC

VENDOR = STATIC / "vendor"


def test_every_file_of_others_is_in_the_manifest_as_it_came() -> None:
    listed = json.loads((VENDOR / "manifest.json").read_text(encoding="utf-8"))["files"]
    for entry in listed:
        content = (VENDOR / entry["file"]).read_bytes()
        assert hashlib.sha256(content).hexdigest() == entry["sha256"], entry["file"]
        assert len(content) < 2**20
        assert (VENDOR / entry["licence_file"]).is_file()
    assert {path.name for path in VENDOR.glob("*.js")} == {entry["file"] for entry in listed}
