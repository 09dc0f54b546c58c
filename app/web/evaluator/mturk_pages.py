"""The page in Mechanical Turk's frame: a preview of the task, and the link that opens the study.

The study opens in its own window: session cookies do not reach a frame of another site, and two
videos need the space. The result is submitted from there.
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

#: Parameter of our link in the frame, for browsers that send no Sec-Fetch-Dest.
OPENED = "opened_in"


def outside_the_study(request: Request, slug: str, app: AppContext) -> Response | None:
    """The page for Mechanical Turk's frame; None for a request from a window of its own."""
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
    """Whether Mechanical Turk opened this link, for an accepted task, rather than our page."""
    return "assignmentId" in given and "turkSubmitTo" in given and OPENED not in given
