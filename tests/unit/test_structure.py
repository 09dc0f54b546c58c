"""Every import in `app` points downward: between rooms, and between the packages of a room."""

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
#: The packages of each room that has some, lowest first: each may import those before it. A file
#: beside the packages stands in the list under its own name.
PACKAGES: dict[str, tuple[str, ...]] = {
    "services": (
        "runtime",
        "server_secret",
        "background",
        "recordings",
        "proposals",
        "deletion_log",
        "failure_counter",
        "platform_keys",
        "context",
        "accounts",
        "jobs",
        "studies",
        "drafts",
        "sessions",
        "arrival",
        "monitoring",
        "export",
        "results",
        "reporting",
        "ethics",
        "bootstrap",
        "maintenance",
    ),
    "web": ("http", "evaluator", "api", "experimenter"),
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


def package_imports(room: str) -> Iterator[tuple[str, str, str]]:
    """Where, from which package, and to which other package of the same room."""
    names = set(PACKAGES[room])
    for other, path in modules():
        parts = path.relative_to(ROOT).with_suffix("").parts
        if other != room or parts[1] == "__init__":
            continue
        for line, name in imports(path):
            target = name.split(".")
            if target[:2] != ["app", room] or len(target) < 3:
                continue
            if target[2] != parts[1] and (target[2] in names or target[2] == parts[1]):
                yield f"{path.relative_to(ROOT.parent)}:{line}", parts[1], target[2]


@pytest.mark.parametrize("room", ["services", "web"])
def test_every_package_is_in_the_order_of_its_room(room: str) -> None:
    found = {
        path.relative_to(ROOT).with_suffix("").parts[1]
        for other, path in modules()
        if other == room
    }
    assert found - {"__init__"} == set(PACKAGES[room])


@pytest.mark.parametrize("room", ["services", "web"])
def test_no_package_imports_one_above_it(room: str) -> None:
    order = PACKAGES[room]
    upward = [
        f"{where}: {above} imports {below}"
        for where, above, below in package_imports(room)
        if order.index(below) > order.index(above)
    ]
    assert upward == []


def test_no_two_modules_import_each_other() -> None:
    """Every cycle of imports, of any length, by Kahn's algorithm: what is left over is in one."""
    files = {
        ".".join(("app", *path.relative_to(ROOT).with_suffix("").parts)): path
        for _, path in modules()
    }
    targets = {
        module: {name for _, name in imports(path) if name in files and name != module}
        for module, path in files.items()
    }
    while leaves := {module for module, found in targets.items() if not found}:
        targets = {
            module: found - leaves for module, found in targets.items() if module not in leaves
        }
    assert targets == {}
