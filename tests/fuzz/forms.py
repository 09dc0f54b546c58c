"""Forms and addresses as nobody fills them in: byte for byte what hostile programs send."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import quote_from_bytes

from fastapi import FastAPI
from fastapi.dependencies.models import Dependant
from fastapi.routing import iter_route_contexts
from hypothesis import strategies as st

#: What comes where a text or a number is meant: bytes, in any encoding or in none.
HOSTILE: tuple[bytes, ...] = (
    b"",
    b" ",
    b"\0",
    b"a\0b",
    b"\xed\xa0\x80",
    b"\xff\xfe",
    "テスト".encode("shift_jis"),
    "\u202ertl \u0627\u0644".encode(),
    "e\u0301\U0001f469\u200d\U0001f52c".encode(),
    "\u0663\u06f1\uff11\u00b2".encode(),
    b"-1",
    b"0",
    b"1e309",
    b"nan",
    b"inf",
    b"0x10",
    b"1_000",
    b"9" * 19,
    b"9" * 5000,
    b"0001-01-01",
    b"9999-12-31",
    b"2026-02-30",
    b"x" * 70_000,
    b"../../../../etc/passwd",
    b"..\\..\\con",
    b"/",
    b"%00%2e%2e",
    b"<script>alert(1)</script>",
    b"{{7*7}}{% x %}",
    b"' OR 1=1 --",
    b"=1+1",
    b"a\r\nSet-Cookie: x=y",
    b"&a: [*b, !!python/object:os.system x]",
    b"- " * 2_000,
    b"[" * 5_000,
    b"null",
    b"true",
    b"on",
    b"all",
    b"live",
    b"admin",
    b"en",
    b"study.yaml",
    b"nobody@lab.example",
)


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", errors="surrogatepass")


Hostile = st.one_of(
    st.sampled_from(HOSTILE), st.binary(max_size=40), st.text(max_size=40).map(_bytes)
)
#: Whatever else a body says it is.
WRONG_TYPES = (
    b"application/json",
    b"text/plain",
    b"application/x-www-form-urlencoded; charset=utf-16",
    b"application/x-www-form-urlencoded; charset=no-such",
    b"multipart/form-data",
    b"multipart/form-data; boundary=other",
    b"\xff",
)
FORM = b"application/x-www-form-urlencoded"
MULTIPART = b"multipart/form-data; boundary=edge"


@dataclass(frozen=True)
class Target:
    """A page, or where a form is sent to. fields: names that its code asks for."""

    method: str
    path: str
    fields: tuple[str, ...]

    @property
    def route(self) -> str:
        return f"{self.method} {self.path}"


@dataclass(frozen=True, repr=False)
class Sent:
    """One request, as bytes."""

    address: str
    content: bytes | None
    content_type: bytes

    def __repr__(self) -> str:
        """Short: hostile is often long."""
        return f"Sent({self.address[:2_000]!r}, {(self.content or b'')[:2_000]!r})"


def targets(application: FastAPI, described: Collection[str]) -> Iterator[Target]:
    """Every page and form; not what the API's document describes already."""
    for context in iter_route_contexts(application.routes):
        if context.path is None or context.path in described:
            continue
        dependant = getattr(context.original_route, "dependant", None)
        fields = tuple(dict.fromkeys(_fields(dependant))) if dependant is not None else ()
        for method in sorted((context.methods or set()) - {"HEAD"}):
            yield Target(method, context.path, fields)


@st.composite
def made_up(
    draw: st.DrawFn, target: Target, known: Mapping[str, str], token: str, names: Sequence[str]
) -> Sent:
    """A request to the target. known: what stands in its path and in a form of its own.

    token: that of our own forms, without which nothing would be read. names: of any form's fields.
    """
    own = (*target.fields, *known)
    name = st.one_of(*([st.sampled_from(own)] * 3 if own else []), st.sampled_from(names))
    field = st.tuples(name.map(str.encode), st.one_of(Hostile, name.map(known_as(known))))
    fields = st.lists(field, max_size=8)
    address = _address(target.path, draw(_parts(target.path, known)), draw(fields))
    if target.method == "GET":
        return Sent(address, None, b"")
    # Most are forms with a token: the others are turned away at the door.
    with_token = draw(st.sampled_from([True, True, True, False]))
    filled = ([(b"csrf_token", token.encode())] if with_token else []) + draw(fields)
    match draw(st.sampled_from(["form", "form", "parts", "half", "of another type", "bytes"])):
        case "form":
            return Sent(address, _urlencoded(filled), FORM)
        case "parts":
            return Sent(address, _multipart(filled) + b"--edge--\r\n", MULTIPART)
        case "half":
            whole = _multipart(filled)
            return Sent(address, whole[: len(whole) // 2], MULTIPART)
        case "bytes":
            return Sent(address, draw(Hostile), draw(st.sampled_from((FORM, MULTIPART))))
    return Sent(address, _urlencoded(filled), draw(st.sampled_from(WRONG_TYPES)))


def known_as(known: Mapping[str, str]) -> Callable[[str], bytes]:
    """The right value of a field, if there is one: what comes after it is then looked at too."""
    return lambda name: known.get(name, "1").encode()


def _fields(dependant: Dependant) -> Iterator[str]:
    for field in (*dependant.body_params, *dependant.query_params):
        yield field.alias
    for inner in dependant.dependencies:
        yield from _fields(inner)


def _parts(path: str, known: Mapping[str, str]) -> st.SearchStrategy[dict[str, bytes]]:
    """What stands in each part of the path: mostly what is there."""
    parts = re.findall(r"\{(\w+)(?::\w+)?\}", path)
    there = {part: st.just(known.get(part, "made-up").encode()) for part in parts}
    anything = {part: st.one_of(there[part], Hostile) for part in parts}
    return st.one_of(st.fixed_dictionaries(there), st.fixed_dictionaries(anything))


def _address(path: str, parts: Mapping[str, bytes], fields: Sequence[tuple[bytes, bytes]]) -> str:
    filled = re.sub(
        r"\{(\w+)(?::\w+)?\}", lambda found: quote_from_bytes(parts[found[1]], safe=""), path
    )
    # Longer than any server takes an address.
    short = [(name, value[:2_000]) for name, value in fields]
    return f"{filled}?{_urlencoded(short).decode()}" if fields else filled


def _urlencoded(fields: Iterable[tuple[bytes, bytes]]) -> bytes:
    return "&".join(
        f"{quote_from_bytes(name)}={quote_from_bytes(value)}" for name, value in fields
    ).encode()


def _multipart(fields: Sequence[tuple[bytes, bytes]]) -> bytes:
    """A form in parts but for its end; files have hostile names."""
    body = b""
    for name, value in fields:
        said = b'form-data; name="' + name + b'"'
        if name == b"files":
            said += b'; filename="' + value[:300].replace(b"\r\n", b"") + b'"'
        body += b"--edge\r\nContent-Disposition: " + said + b"\r\n\r\n" + value + b"\r\n"
    return body
