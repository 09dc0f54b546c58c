"""The documents agree with the code: settings, paths, packages and tests that they name."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from app.services.runtime.settings import Settings
from tests.unit.test_structure import PACKAGES

ROOT = Path(__file__).parents[2]
DOCUMENTS = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")),
    *sorted((ROOT / "docs").glob("*.md")),
]
FOLDERS = "app|static|templates|tests|migrations|deploy|docs"
MARKED = re.compile(r"<!-- settings: [^\n]*-->\n(.*?)<!-- end of settings -->", re.DOTALL)


def settings_table() -> str:
    """A row for each setting, in the order of the code."""
    rows = ["| variable | what it sets | default |", "|---|---|---|"]
    for name, field in Settings.model_fields.items():
        default = field.get_default()
        said = "" if default in (None, "") else f"`{str(default).lower()}`"
        rows.append(f"| `PBPO_{name.upper()}` | {field.description} | {said} |")
    return "\n".join(rows) + "\n"


def test_the_table_of_settings_is_that_of_the_code() -> None:
    found = MARKED.search((ROOT / "docs" / "operations.md").read_text("utf-8"))
    assert found
    assert found[1] == settings_table()


def test_every_setting_that_the_readme_names_exists() -> None:
    named = set(re.findall(r"PBPO_[A-Z_]+", (ROOT / "README.md").read_text("utf-8")))
    assert named <= {f"PBPO_{name.upper()}" for name in Settings.model_fields}


def paths_named(text: str) -> set[str]:
    return set(re.findall(rf"(?<![\w/.-])(?:{FOLDERS})/[\w./-]*\w", text))


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_every_path_that_a_document_names_exists(document: Path) -> None:
    named = paths_named(document.read_text("utf-8"))
    assert sorted(path for path in named if not (ROOT / path).exists()) == []


def test_the_map_lists_the_packages_of_services_in_their_order() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    section = text.split("### Packages of `app/services`")[1].split("\n### ")[0]
    listed = re.findall(r"^\| `(\w+)(?:/|\.py)` \|", section, re.MULTILINE)
    assert tuple(listed) == PACKAGES["services"]


def security_rows() -> list[tuple[str, str]]:
    """Each threat of SECURITY.md with the cell that names its tests."""
    text = (ROOT / "SECURITY.md").read_text("utf-8")
    rows = [line.strip("|").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return [(row[0].strip(), row[-1]) for row in rows[1:]]


@pytest.mark.parametrize(("threat", "cell"), security_rows())
def test_each_threat_names_tests_that_are_there(threat: str, cell: str) -> None:
    path: Path | None = None
    names = re.findall(r"`([^`]+)`", cell)
    assert names, threat
    for name in names:
        file, _, test = name.rpartition("::")
        # A test without a file lies in the file that was named before it.
        path = ROOT / file if file else path
        assert path is not None, name
        assert re.search(rf"def {test}\(", path.read_text("utf-8")), f"{threat}: {name}"
