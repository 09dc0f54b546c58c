"""What the browsers that the first page lets in can all do, and no more."""

from __future__ import annotations

import re

import pytest

from app.web.http.older_browsers import without_layers
from app.web.http.templating import STATIC

SCRIPTS = sorted((STATIC / "js").glob("*.js"))

#: Missing in Safari 15.4, Chrome 92 or Firefox 91: a script that calls it fails there.
TOO_NEW = (
    r"AbortSignal\.(timeout|any)",
    r"Promise\.(withResolvers|try)",
    r"\bArray\.fromAsync",
    r"(Object|Map)\.groupBy",
    r"\.(findLast|findLastIndex|toSorted|toReversed|toSpliced|with)\(",
    r"\.(isWellFormed|toWellFormed)\(",
    r"\brequestSubmit\(",
    r"\bcheckVisibility\(",
    r"\bstartViewTransition\b",
    r"\bshowPopover\b",
    r"\bnavigation\.",
    r"\bscheduler\.",
    r"URL\.(canParse|parse)\(",
    r"\bcrypto\.randomUUID\(",
    r"\brequestIdleCallback\(",
    r"^\s*static\s*\{",
    r"\bObject\.hasOwn\(",
    r"\bstructuredClone\(",
    r"\(\?<[=!]",
)

#: In plain old words: browsers that cannot read the others run these.
PLAIN = ("browser_support.js", "fallback.js", "older_browsers.js")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_no_script_calls_what_a_supported_browser_lacks(script: object) -> None:
    text = re.sub(r"/\*.*?\*/|//[^\n]*", "", (STATIC / "js" / str(script)).read_text(), flags=re.S)
    assert [name for name in TOO_NEW if re.search(name, text, re.M)] == []


@pytest.mark.parametrize("name", PLAIN)
def test_what_watches_over_the_others_is_readable_by_every_browser(name: str) -> None:
    text = re.sub(r"/\*.*?\*/|//[^\n]*", "", (STATIC / "js" / name).read_text(), flags=re.S)
    newer = r"=>|\b(let|const|class|async|await|import|export)\b|\?\.|\?\?|`|\.\.\."
    assert re.findall(newer, text) == []


def test_browsers_without_layers_get_every_rule_of_the_stylesheet_in_its_order() -> None:
    css = (STATIC / "css" / "app.css").read_text(encoding="utf-8")
    flat = without_layers(css)
    assert "@layer" not in flat
    selector = re.compile(r"[^{};]+(?=\{)")
    of_both = [
        [found.strip() for found in selector.findall(re.sub(r"/\*.*?\*/", "", text, flags=re.S))]
        for text in (css, flat)
    ]
    heads = [head for head in of_both[0] if not head.startswith("@layer")]
    assert of_both[1] == heads
    assert len(heads) > 300
