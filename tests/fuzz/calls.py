"""Calls made up from the OpenAPI document, and what their answers are held to.

schemathesis makes the calls up, the right and the wrong ones, and compares each answer with the
document; they go through our own client, byte by byte.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import httpx
import requests
import schemathesis
from hypothesis import strategies as st
from schemathesis import APIOperation, BaseSchema, CheckFunction, GenerationMode
from schemathesis import Case as AnyCase
from schemathesis.checks import not_a_server_error
from schemathesis.core.result import Ok
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    negative_data_rejection,
    positive_data_acceptance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from tests.functional.client import Api

Case = AnyCase[Any]
Operation = APIOperation[Any, Any, Any, Any]

CHECKS: list[CheckFunction] = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    negative_data_rejection,
    positive_data_acceptance,
]

#: Refusals of well-formed calls for what they say: a document cannot tell of these beforehand.
_BY_MEANING = ("answers-refused", "skip-reason")

BASE = "http://testserver"


def read_document(client: Api) -> BaseSchema:
    """What the application says of itself."""
    answer = client.get("/openapi.json")
    assert answer.status_code == 200
    return schemathesis.openapi.from_dict(answer.json())


def operations(document: BaseSchema) -> list[Operation]:
    found = [one.ok() for one in document.get_all_operations() if isinstance(one, Ok)]
    assert len(found) == len(document)
    return found


def made_up(operation: Operation, known: dict[str, Any]) -> st.SearchStrategy[Case]:
    """Right and wrong calls; the right ones name what is there, half of the time."""
    slug = {"slug": "short"}
    right = operation.as_strategy(generation_mode=GenerationMode.POSITIVE, path_parameters=slug)
    wrong = operation.as_strategy(generation_mode=GenerationMode.NEGATIVE)
    apt = st.tuples(right, st.booleans()).map(lambda drawn: _apt(drawn[0], drawn[1], known))
    return st.one_of(apt, wrong)


def on_the_edges(document: BaseSchema, operation: Operation) -> Iterator[Case]:
    """Calls at the limits of what the document allows, within and beyond, alike each time."""
    return document.iter_coverage_cases(
        operation,
        generation_modes=[GenerationMode.POSITIVE, GenerationMode.NEGATIVE],
        generation_config=document.config.generation_for(operation=operation),
    )


def ask(client: Api, case: Case, token: str | None) -> httpx.Response:
    """Send the call as it was made up, with a token or without one."""
    headers = {} if token is None else {"Authorization": f"Bearer {token}"}
    said = case.as_transport_kwargs(base_url=BASE, headers=headers)
    sent = requests.Request(
        **{key: value for key, value in said.items() if key in _OF_A_REQUEST}
    ).prepare()
    return client.request(
        sent.method or "GET",
        sent.url or "",
        headers=[(_bytes(name), _bytes(value)) for name, value in sent.headers.items()],
        content=sent.body,
    )


def hold(case: Case, answer: httpx.Response) -> None:
    """Raises if the answer is not as the document says."""
    left_out: list[CheckFunction] = []
    if answer.status_code == 422 and answer.json()["type"].endswith(_BY_MEANING):
        left_out.append(positive_data_acceptance)
    case.validate_response(answer, checks=CHECKS, excluded_checks=left_out)


_OF_A_REQUEST = {"method", "url", "headers", "files", "data", "json", "params", "auth", "cookies"}


def _bytes(value: str | bytes) -> bytes:
    return value if isinstance(value, bytes) else value.encode("latin-1", errors="replace")


def _apt(case: Case, named: bool, known: dict[str, Any]) -> Case:
    if named and isinstance(case.body, dict):
        case.body = deepcopy(case.body)
        case.body.update({key: value for key, value in known.items() if key in case.body})
    return case
