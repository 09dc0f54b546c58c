"""The program that connects a machine to a study, as a file to download."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import FileResponse

from app.web.http.templating import STATIC

router = APIRouter(include_in_schema=False)


@router.api_route("/machine/pbpo_machine.py", methods=["GET", "HEAD"])
def machine_program() -> FileResponse:
    """The program. It holds no secret, so whoever has the address may read it."""
    return FileResponse(
        STATIC / "machine" / "pbpo_machine.py",
        media_type="text/x-python; charset=utf-8",
        filename="pbpo_machine.py",
        headers={"Cache-Control": "no-cache"},
    )
