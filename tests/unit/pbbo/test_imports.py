"""Which modules of the optimiser import which."""

import ast
from pathlib import Path

import app.pbbo

ROOM = Path(app.pbbo.__file__).parent


def imported(path: Path) -> set[str]:
    """The modules of this room that a file imports, wherever in it; not for types alone."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = []
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("app.pbbo"):
            module = (node.module or "").removeprefix("app.pbbo").removeprefix(".")
            names |= {module} if module else {alias.name for alias in node.names}
    return names


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = {path.stem: imported(path) for path in ROOM.glob("*.py") if path.stem != "__init__"}

    def reached(module: str) -> set[str]:
        found: set[str] = set()
        ahead = set(graph[module])
        while ahead:
            one = ahead.pop()
            if one not in found:
                found.add(one)
                ahead |= graph.get(one, set())
        return found

    assert {module for module in graph if module in reached(module)} == set()
    assert "comparisons" in graph["length_scale"] & graph["model"]
