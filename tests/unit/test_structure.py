"""Every import in `app` points downward: between layers, and between the packages of a layer."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import app

ROOT = Path(app.__file__).parent

#: What each layer may import. A layer may always import itself.
PURE: frozenset[str] = frozenset({"pbbo", "crane", "study", "statistics", "video"})
ALLOWED: dict[str, frozenset[str]] = {
    "pbbo": frozenset(),
    "crane": frozenset(),
    "study": frozenset({"video"}),
    "statistics": frozenset(),
    "video": frozenset(),
    "figures": frozenset(),
    "lab": PURE | {"figures"},
    "storage": frozenset({"study"}),
    "services": PURE | {"storage", "figures"},
    "web": PURE | {"storage", "figures", "services"},
    "main": PURE | {"storage", "figures", "services", "web"},
    "server": frozenset({"services", "web", "main", "simulation"}),
    "worker": frozenset({"services", "simulation", "storage"}),
    "simulated_recordings": PURE | {"storage", "services", "lab"},
    "simulation": PURE | {"storage", "services", "lab", "web", "main", "simulated_recordings"},
    "commands": PURE | {"services", "server", "worker", "simulation", "main", "lab"},
    "cli": PURE | {"services", "commands", "server", "simulation", "main", "lab"},
}
#: The packages of each layer that has some, lowest first: each may import those before it. A file
#: beside the packages is listed by its own name.
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
        "rollouts",
        "sessions",
        "arrival",
        "monitoring",
        "pooling",
        "export",
        "results",
        "reporting",
        "ethics",
        "bootstrap",
        "maintenance",
    ),
    "web": ("http", "evaluator", "api", "experimenter"),
}
#: Libraries of the web and the database, which the pure packages may not import.
FORBIDDEN_IN_PURE = {"fastapi", "starlette", "sqlalchemy", "alembic", "jinja2", "uvicorn", "httpx"}


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


def test_every_layer_has_a_rule() -> None:
    assert {layer for layer, _ in modules()} <= set(ALLOWED)


def test_no_import_points_upward() -> None:
    upward = []
    for layer, path in modules():
        for line, name in imports(path):
            parts = name.split(".")
            if parts[0] != "app" or len(parts) == 1 or parts[1].startswith("__"):
                continue
            if parts[1] != layer and parts[1] not in ALLOWED[layer]:
                upward.append(f"{path.relative_to(ROOT.parent)}:{line} imports {name}")
    assert upward == []


def test_pure_packages_import_neither_the_web_nor_the_database() -> None:
    forbidden = [
        f"{path.relative_to(ROOT.parent)}:{line} imports {name}"
        for layer, path in modules()
        if layer in PURE
        for line, name in imports(path)
        if name.split(".")[0] in FORBIDDEN_IN_PURE
    ]
    assert forbidden == []


@pytest.mark.parametrize("name", ["utils", "common", "helpers", "core"])
def test_no_file_has_a_catch_all_name(name: str) -> None:
    paths = [path.relative_to(ROOT).with_suffix("") for _, path in modules()]
    assert [path for path in paths if name in path.parts] == []


def package_imports(layer: str) -> Iterator[tuple[str, str, str]]:
    """Location, importing package and imported package, for imports within one layer."""
    names = set(PACKAGES[layer])
    for other, path in modules():
        parts = path.relative_to(ROOT).with_suffix("").parts
        if other != layer or parts[1] == "__init__":
            continue
        for line, name in imports(path):
            target = name.split(".")
            if target[:2] != ["app", layer] or len(target) < 3:
                continue
            if target[2] != parts[1] and (target[2] in names or target[2] == parts[1]):
                yield f"{path.relative_to(ROOT.parent)}:{line}", parts[1], target[2]


@pytest.mark.parametrize("layer", ["services", "web"])
def test_every_package_is_in_the_order_of_its_layer(layer: str) -> None:
    found = {
        path.relative_to(ROOT).with_suffix("").parts[1]
        for other, path in modules()
        if other == layer
    }
    assert found - {"__init__"} == set(PACKAGES[layer])


@pytest.mark.parametrize("layer", ["services", "web"])
def test_no_package_imports_one_above_it(layer: str) -> None:
    order = PACKAGES[layer]
    upward = [
        f"{where}: {importer} imports {imported}"
        for where, importer, imported in package_imports(layer)
        if order.index(imported) > order.index(importer)
    ]
    assert upward == []


def test_no_two_modules_import_each_other() -> None:
    """Kahn's algorithm: the modules that remain at the end are in a cycle, of any length."""
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


@pytest.mark.parametrize("layer", ["study", "web"])
def test_every_public_function_and_class_has_a_docstring(layer: str) -> None:
    kinds = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
    missing = [
        f"{path.relative_to(ROOT.parent)}:{node.lineno} {node.name}"
        for other, path in modules()
        if other == layer
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, kinds) and not node.name.startswith("_") and not ast.get_docstring(node)
    ]
    assert missing == []
