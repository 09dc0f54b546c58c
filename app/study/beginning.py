"""The first `study.yaml` of a study made in the browser: the commented example, renamed."""

from __future__ import annotations

import csv
import io
import re
import unicodedata
from collections.abc import Sequence
from pathlib import Path

from ruamel.yaml.comments import CommentedMap

from app.study.recordings import FILE_COLUMN, SCORE_COLUMN
from app.study.scaffold import EXAMPLE
from app.study.yaml_edit import edited, put

#: What stands in the place of a study's own environment until it is called something.
ENVIRONMENT = "videos"
LONGEST_SLUG = 60


def slug_of(title: str) -> str:
    """A name for links made of a title: `Pouring water!` becomes `pouring-water`."""
    plain = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[:LONGEST_SLUG].strip("-") or "my-study"


def parameters_of(csv_text: str) -> list[str]:
    """The columns of a recordings' CSV that are parameters."""
    header = next(csv.reader(io.StringIO(csv_text)), [])
    names = [name.strip() for name in header]
    return [name for name in names if name and name not in (FILE_COLUMN, SCORE_COLUMN)]


def begin_plan(title: str, source: str = "recordings.csv", parameters: Sequence[str] = ()) -> str:
    """A `study.yaml` with every key explained. Without parameters the example's stand there."""
    text = (EXAMPLE / "study.yaml").read_text(encoding="utf-8")
    text = text.replace("  kitchen:\n    label: Kitchen\n", f"  {ENVIRONMENT}:\n")
    text = text.replace("environment: kitchen", f"environment: {ENVIRONMENT}")

    def fill(data: CommentedMap) -> None:
        put(data, "slug", slug_of(title))
        put(data, "title", title)
        put(data["environments"][ENVIRONMENT], "source", source)
        if parameters:
            put(data, "parameters", [{"name": name} for name in parameters])

    return edited(text, fill)


def example_texts() -> dict[str, str]:
    """The example's English texts by their places in a folder, with places to be filled in."""
    folder: Path = EXAMPLE / "texts" / "en"
    return {f"texts/en/{path.name}": path.read_text(encoding="utf-8") for path in folder.iterdir()}
