"""The house holds: every import in `app` points downward."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import app

ROOT = Path(app.__file__).parent

#: What each room may import. A room may always import itself.
GROUND: frozenset[str] = frozenset({"pbbo", "crane", "study", "statistics", "video"})
ALLOWED: dict[str, frozenset[str]] = {
    "pbbo": frozenset(),
    "crane": frozenset(),
    "study": frozenset({"video"}),
    "statistics": frozenset(),
    "video": frozenset(),
    "figures": frozenset(),
    "lab": GROUND | {"figures"},
    "storage": frozenset({"study"}),
    "services": GROUND | {"storage", "figures"},
    "web": GROUND | {"storage", "figures", "services"},
    "main": GROUND | {"storage", "figures", "services", "web"},
    "server": frozenset({"services", "main", "simulation"}),
    "worker": frozenset({"services", "simulation", "storage"}),
    "simulation": GROUND | {"storage", "services", "lab", "web", "main"},
    "commands": GROUND | {"services", "server", "worker", "simulation", "main", "lab"},
    "cli": GROUND | {"services", "commands", "server", "simulation", "main", "lab"},
}
#: The ground rooms know neither the web nor the database.
FOREIGN_TO_GROUND = {"fastapi", "starlette", "sqlalchemy", "alembic", "jinja2", "uvicorn", "httpx"}


def modules() -> Iterator[tuple[str, Path]]:
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        if parts != ("__init__",):
            yield parts[0], path


def imports(path: Path) -> Iterator[tuple[int, str]]:
    package = ("app", *path.relative_to(ROOT).parent.parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            name = ".".join(part for part in (base, node.module or "") if part)
            yield node.lineno, name
            for alias in node.names:
                yield node.lineno, f"{name}.{alias.name}"


def test_every_room_is_known_to_the_plan_of_the_house() -> None:
    assert {room for room, _ in modules()} <= set(ALLOWED)


def test_no_import_points_upward() -> None:
    upward = []
    for room, path in modules():
        for line, name in imports(path):
            parts = name.split(".")
            if parts[0] != "app" or len(parts) == 1 or parts[1].startswith("__"):
                continue
            if parts[1] != room and parts[1] not in ALLOWED[room]:
                upward.append(f"{path.relative_to(ROOT.parent)}:{line} imports {name}")
    assert upward == []


def test_the_ground_rooms_know_neither_the_web_nor_the_database() -> None:
    foreign = [
        f"{path.relative_to(ROOT.parent)}:{line} imports {name}"
        for room, path in modules()
        if room in GROUND
        for line, name in imports(path)
        if name.split(".")[0] in FOREIGN_TO_GROUND
    ]
    assert foreign == []


@pytest.mark.parametrize("name", ["utils", "common", "helpers", "core"])
def test_no_file_is_named_after_nothing(name: str) -> None:
    paths = [path.relative_to(ROOT).with_suffix("") for _, path in modules()]
    assert [path for path in paths if name in path.parts] == []
