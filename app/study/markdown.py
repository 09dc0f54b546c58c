"""Renders a study's Markdown to safe HTML, and computes the version of a consent text."""

import hashlib
import unicodedata
from collections.abc import Sequence
from typing import Any

from markdown_it import MarkdownIt
from markdown_it.renderer import RendererHTML
from markdown_it.rules_core import StateCore
from markdown_it.token import Token
from markdown_it.utils import EnvType, OptionsDict

# The page's own title is its one h1.
FIRST_HEADING_LEVEL = 2
LAST_HEADING_LEVEL = 6
CONSENT_VERSION_DIGITS = 12


def render(markdown: str) -> str:
    """HTML of a study's text. Raw HTML in it is shown as written, never run."""
    rendered: str = _MARKDOWN.render(markdown)
    return rendered


def consent_version(markdown: str) -> str:
    """The first 12 hex digits of the SHA-256 of the text.

    Line ends, trailing blanks and Unicode normalisation are ignored: they are invisible to readers,
    and a new version requires everyone's consent again.
    """
    lines = unicodedata.normalize("NFC", markdown).splitlines()
    normalised = "\n".join(line.rstrip() for line in lines).strip()
    return hashlib.sha256(normalised.encode("utf-8")).hexdigest()[:CONSENT_VERSION_DIGITS]


def _lower_headings(state: StateCore) -> None:
    for token in state.tokens:
        if token.type in ("heading_open", "heading_close"):
            level = int(token.tag.removeprefix("h")) + FIRST_HEADING_LEVEL - 1
            token.tag = f"h{min(level, LAST_HEADING_LEVEL)}"


def _link_open(
    renderer: RendererHTML,
    tokens: Sequence[Token],
    index: int,
    options: OptionsDict,
    env: EnvType,
) -> str:
    # A link opens in a new tab, so that the study stays open, and its target receives
    # neither the referrer nor a handle on the study's window.
    tokens[index].attrSet("target", "_blank")
    tokens[index].attrSet("rel", "noopener noreferrer")
    return renderer.renderToken(tokens, index, options, env)


def _markdown() -> Any:
    # Images are left out: a study page loads nothing from elsewhere, and texts have no files.
    markdown = MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")
    markdown.core.ruler.push("lower_headings", _lower_headings)
    markdown.add_render_rule("link_open", _link_open)
    return markdown


_MARKDOWN = _markdown()
