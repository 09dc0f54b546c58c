"""What machines ask a server: whether it lives, whether it can work, and what it measures."""

from __future__ import annotations

import hmac
from typing import Annotated

from fastapi import APIRouter, Header
from fastapi.responses import JSONResponse, Response
from prometheus_client import CONTENT_TYPE_LATEST

from app.services.monitoring import health

from .security import AppDep, bearer

router = APIRouter(include_in_schema=False)

_FRESH = {"Cache-Control": "no-store"}

#: Watchmen and load balancers often ask for the head alone.
_ASKED_BY = ["GET", "HEAD"]


@router.api_route("/healthz", methods=_ASKED_BY)
async def alive() -> Response:
    """The process answers. It asks nothing else, so that a database's fault restarts no server."""
    return JSONResponse({"alive": True}, headers=_FRESH)


@router.api_route("/readyz", methods=_ASKED_BY)
def ready(app: AppDep) -> Response:
    """Whether evaluators can be sent here: 503 says why not, a sentence for each fault.

    What is wrong and turns nobody away is said beside that, as warnings.
    """
    found = health.faults(app)
    body = {"ready": not found, "faults": found, "warnings": health.warnings(app)}
    return JSONResponse(body, 503 if found else 200, headers=_FRESH)


@router.get("/metrics")
def metrics(
    app: AppDep,
    authorization: Annotated[str | None, Header()] = None,
) -> Response:
    """The measurements, for whoever holds the token; without one in the settings, nothing."""
    token = app.settings.metrics_token
    if token is None:
        return Response(status_code=404, headers=_FRESH)
    given = (bearer(authorization) or "").encode()
    if not hmac.compare_digest(given, token.get_secret_value().encode()):
        return Response(status_code=401, headers={**_FRESH, "WWW-Authenticate": "Bearer"})
    return Response(health.metrics(app), media_type=CONTENT_TYPE_LATEST, headers=_FRESH)
