"""Routes for monitoring: liveness, readiness and metrics."""

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

#: Monitors and load balancers often send HEAD.
_ASKED_BY = ["GET", "HEAD"]


@router.api_route("/healthz", methods=_ASKED_BY)
async def alive() -> Response:
    """Answers 200 while the process runs. It does not use the database."""
    return JSONResponse({"alive": True}, headers=_FRESH)


@router.api_route("/readyz", methods=_ASKED_BY)
def ready(app: AppDep) -> Response:
    """Whether evaluators can be sent here: 503 with a sentence for each fault.

    Conditions that keep no evaluator out are listed as warnings.
    """
    found = health.faults(app)
    body = {"ready": not found, "faults": found, "warnings": health.warnings(app)}
    return JSONResponse(body, 503 if found else 200, headers=_FRESH)


@router.get("/metrics")
def metrics(
    app: AppDep,
    authorization: Annotated[str | None, Header()] = None,
) -> Response:
    """Prometheus metrics for the bearer of the token; 404 if no token is set."""
    token = app.settings.metrics_token
    if token is None:
        return Response(status_code=404, headers=_FRESH)
    given = (bearer(authorization) or "").encode()
    if not hmac.compare_digest(given, token.get_secret_value().encode()):
        return Response(status_code=401, headers={**_FRESH, "WWW-Authenticate": "Bearer"})
    return Response(health.metrics(app), media_type=CONTENT_TYPE_LATEST, headers=_FRESH)
