"""The first `study.yaml` of a study created in the browser: the commented example, renamed."""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Mapping, Sequence
from pathlib import Path

from ruamel.yaml.comments import CommentedMap

from .scaffold import EXAMPLE
from .yaml_edit import edited, set_key

#: Placeholder for the name of a study's own environment.
ENVIRONMENT = "videos"
LONGEST_SLUG = 60


def slug_of(title: str) -> str:
    """A slug derived from a title: `Pouring water!` becomes `pouring-water`.

    If most letters are outside a to z, different titles could give the same slug: then six
    characters of the title's hash are appended, as in `study-3fa9c1`.
    """
    taken_apart = unicodedata.normalize("NFKD", title.casefold())
    plain = taken_apart.encode("ascii", "ignore").decode()
    slug = re.sub(r"[^a-z0-9]+", "-", plain).strip("-")
    letters = [letter for letter in taken_apart if letter.isalpha()]
    if letters and 2 * sum(map(str.isascii, letters)) < len(letters):
        digest = hashlib.sha256(unicodedata.normalize("NFC", title).encode()).hexdigest()[:6]
        slug = f"{slug[: LONGEST_SLUG - 7].strip('-') or 'study'}-{digest}"
    return slug[:LONGEST_SLUG].strip("-") or "my-study"


def begin_plan(
    title: str,
    source: str = "recordings.csv",
    parameters: Sequence[Mapping[str, object]] = (),
    slug: str | None = None,
) -> str:
    """A `study.yaml` with every key explained. Without parameters it has those of the example.

    parameters: their entries in the file. slug: by default derived from the title.
    """
    text = (EXAMPLE / "study.yaml").read_text(encoding="utf-8")
    text = text.replace("  kitchen:\n    label: Kitchen\n", f"  {ENVIRONMENT}:\n")
    text = text.replace("environment: kitchen", f"environment: {ENVIRONMENT}")

    def fill(data: CommentedMap) -> None:
        set_key(data, "slug", slug or slug_of(title))
        set_key(data, "title", title)
        set_key(data["environments"][ENVIRONMENT], "source", source)
        if parameters:
            set_key(data, "parameters", list(map(dict, parameters)))

    return edited(text, fill)


def example_texts() -> dict[str, str]:
    """The example's English texts, with placeholders, by their paths in a folder."""
    folder: Path = EXAMPLE / "texts" / "en"
    return {f"texts/en/{path.name}": path.read_text(encoding="utf-8") for path in folder.iterdir()}
