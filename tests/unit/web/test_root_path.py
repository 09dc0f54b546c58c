"""No template and no script names an address of the studio without the path below which it is."""

from __future__ import annotations

import re

import pytest

from app.web.http.templating import ROOT, STATIC

TEMPLATES = sorted((ROOT / "templates").rglob("*.html"))
SCRIPTS = sorted((STATIC / "js").glob("*.js"))

#: Attributes with an address.
ADDRESS = re.compile(
    r"\s(?:href|src|action|formaction|poster|data-(?:job|live|events|figure|answer|trouble))"
    r'="([^"{]*(?:\{\{.*?\}\}|\{%.*?%\}|[^"{])*)"'
)
#: What a whole address begins with: the path, a place on this page, its parameters, a kind.
WHOLE = re.compile(r"\{\{ root \}\}|#|\?|data:|https:|mailto:|\{\{ static_url\(")
#: Values that Python has made whole, and what is on other sites.
MADE_WHOLE = {
    "{{ way_back.url }}",
    "{{ delete_url }}",
    "{{ language.url }}",
    "{{ one.url }}",
    "{{ recorded.url }}",
    # No address: what kind of trouble it is, on an overview.
    "{{ trouble.name }}",
    # Within a sentence for translators, which sets it by `root`.
    "{{ url }}",
}


def addresses(text: str) -> list[str]:
    return [found[1] for found in ADDRESS.finditer(text)]


@pytest.mark.parametrize("template", TEMPLATES, ids=lambda path: path.name)
def test_every_address_of_a_template_begins_with_the_path(template: object) -> None:
    text = (ROOT / "templates" / str(template)).read_text(encoding="utf-8")
    bare = [it for it in addresses(text) if it and not WHOLE.match(it) and it not in MADE_WHOLE]
    assert bare == []
    for sentence in re.findall(r"\{% trans (?:[^%]|%[^}])*url=([^,%]+)", text):
        assert sentence.strip() == "url" or sentence.startswith("root ~ "), sentence


def test_the_templates_have_addresses_to_look_at() -> None:
    found = [address for file in TEMPLATES for address in addresses(file.read_text("utf-8"))]
    assert len(found) > 150
    assert addresses('<a class="x" href="/studies">') == ["/studies"]
    assert addresses('<form action="{{ base }}/consent{{ query }}">') == [
        "{{ base }}/consent{{ query }}"
    ]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_no_script_names_an_address_without_the_path(script: object) -> None:
    text = (STATIC / "js" / str(script)).read_text(encoding="utf-8")
    text = re.sub(r"/\*.*?\*/|(?m:^\s*//[^\n]*)", "", text, flags=re.S)
    literals = re.findall(r"""(.{0,60})(["'`])(/(?:[a-z][^"'`]*)?)\2""", text)
    # The calls of a session are made in one place, which puts both before them.
    whole = ('getAttribute("data-root") || "") + ', '#call("GET", ', '#call("POST", ')
    assert [it for before, _, it in literals if not before.endswith(whole)] == []
