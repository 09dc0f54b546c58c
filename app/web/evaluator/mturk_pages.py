"""What Mechanical Turk shows in its frame: a look at the task, and the door to it.

The study itself opens in a window of its own: the cookie that holds a session does not reach a
frame of another site, and two videos need the room. The result is sent from there.
"""

from __future__ import annotations

from fastapi import Request
from fastapi.responses import Response
from starlette.datastructures import QueryParams

from app.services.arrival import admission
from app.services.context import AppContext
from app.services.studies import repository, session_modes
from app.study.recruitment import MTURK_FRAMES, is_mturk_preview
from app.web.http import languages, session_paths
from app.web.http.security import POLICY, content_security_policy

from .session_pages import render

#: In the address that the door leads to, for browsers that send no Sec-Fetch-Dest.
OPENED = "opened_in"


def outside_the_study(request: Request, slug: str, app: AppContext) -> Response | None:
    """The page for Mechanical Turk's frame; None for whoever is in a window of our own."""
    given = request.query_params
    where = request.headers.get("sec-fetch-dest")
    in_frame = where == "iframe" or (where is None and _is_accepted(given))
    if session_paths.mode_of(request) != session_modes.LIVE:
        return None
    if "assignmentId" not in given and not in_frame:
        return None
    plan = repository.find(app, slug).plan
    recruitment = plan.recruitment
    is_preview = is_mturk_preview(recruitment, given)
    if recruitment.platform != "mturk" or not (is_preview or in_frame):
        return None
    landing = admission.landing_page(app, slug, languages.of_reader(request, plan.languages))
    response = render(
        request,
        slug,
        "participant/mturk.html",
        landing.title,
        study_title=landing.title,
        language=landing.language,
        html=landing.consent["html"],
        is_preview=is_preview,
        # A browser that does not say where it shows a page says by this that it is in no frame.
        query_string=f"?{request.url.query}" + ("" if where else f"&{OPENED}=window"),
    )
    response.headers[POLICY] = content_security_policy(
        app.recordings.origin, frame_ancestors=MTURK_FRAMES
    )
    return response


def _is_accepted(given: QueryParams) -> bool:
    """Whether the link is Mechanical Turk's own of an accepted task, and not yet the door's."""
    return "assignmentId" in given and "turkSubmitTo" in given and OPENED not in given
