"""Languages of a study's pages: which one a reader prefers, and links to the others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fastapi import Request

from app.study.page_words import direction, own_name

#: The parameter of a link that names a language.
PARAMETER = "lang"


def preferred(accepted: str, offered: Sequence[str]) -> str | None:
    """The first offered language that the browser's Accept-Language asks for; None if none is."""
    wanted: list[tuple[float, str]] = []
    for part in accepted.split(","):
        tag, _, weight = part.strip().partition(";q=")
        try:
            wanted.append((float(weight or 1), tag.strip().lower()))
        except ValueError:
            continue
    for _, tag in sorted(wanted, key=lambda pair: -pair[0]):
        for language in offered:
            if language.lower() == tag or language.lower().split("-")[0] == tag.split("-")[0]:
                return language
    return None


def of_reader(request: Request, offered: Sequence[str]) -> str:
    """The offered language that the link names, else the one the browser asks for, else the first.

    offered: of a study its languages; where no study is known, those that our own pages speak.
    """
    named = request.query_params.get(PARAMETER)
    if named is not None and named in offered:
        return named
    return preferred(request.headers.get("accept-language", ""), offered) or offered[0]


def links(request: Request, offered: Sequence[str], current: str) -> list[dict[str, Any]]:
    """This very page in each of the offered languages; none where there is no choice.

    A page that answers a form has no address of its own to link to.
    """
    if len(offered) < 2 or request.method != "GET":
        return []
    return [
        {
            "code": code,
            "name": own_name(code),
            "direction": direction(code),
            "url": f"?{request.url.include_query_params(**{PARAMETER: code}).query}",
            "is_current": code == current,
        }
        for code in offered
    ]
