"""Recruitment platforms: the parameters of their links, and the links back to them.

Prolific returns by `submissions/complete?cc=CODE`; CloudResearch Connect by
`participant/project/PROJECT/complete`; SONA grants credit at the study's own client-side
completion address, given the survey code; Mechanical Turk takes a form at `externalSubmit`.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal
from urllib.parse import parse_qsl, quote, urlencode, urlsplit, urlunsplit

from pydantic import Field, StrictBool, StrictStr, StringConstraints

from . import identifiers
from .identifiers import Given
from .parsed_plan import Inconsistency, Place, as_list, as_mapping
from .plan_model import Part, absent

NO_PLATFORM = "none"
#: A survey tool or platform that the studio does not know, whose link has parameters of its own.
OTHER = "other"

#: The outcomes of a session that a platform distinguishes.
Outcome = Literal["completed", "screened_out", "declined", "withdrawn", "technical"]

#: Where Mechanical Turk takes results, and nowhere else: the address comes from the link.
MTURK_HOSTS = ("www.mturk.com", "workersandbox.mturk.com")
#: The pages in whose frame Mechanical Turk shows a task.
MTURK_FRAMES = ("https://worker.mturk.com", "https://workersandbox.mturk.com")
_NOT_ACCEPTED = "ASSIGNMENT_ID_NOT_AVAILABLE"

#: Form of an id that may become part of an address.
_PLACE = re.compile(r"\{([A-Za-z0-9_]+)\}")
_PLAIN_ID = re.compile(r"[A-Za-z0-9_-]{1,64}")


@dataclass(frozen=True)
class Platform:
    """What a platform adds to the link, and which of it names the person.

    submission: the parameter that names this one submission. A stranger cannot guess its value, as
    they can look up or guess that of `person`. None where the platform has no such parameter.
    """

    label: str
    parameters: tuple[str, ...]
    person: str
    submission: str | None


PLATFORMS: Mapping[str, Platform] = {
    "prolific": Platform(
        "Prolific", ("PROLIFIC_PID", "STUDY_ID", "SESSION_ID"), "PROLIFIC_PID", "SESSION_ID"
    ),
    "connect": Platform(
        "CloudResearch Connect",
        ("participantId", "assignmentId", "projectId"),
        "participantId",
        "assignmentId",
    ),
    # SONA's parameter is the study's own choice: `Recruitment.parameter`.
    "sona": Platform("SONA", (), "", None),
    "mturk": Platform(
        "Mechanical Turk",
        ("workerId", "assignmentId", "hitId", "turkSubmitTo"),
        "workerId",
        "assignmentId",
    ),
}

_CODE_FORM = "a code of up to 60 letters, digits, - and _"
Code = Annotated[StrictStr, StringConstraints(pattern=r"^[A-Za-z0-9_-]{1,60}$")]
ParameterName = Annotated[StrictStr, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,39}$")]
Address = Annotated[StrictStr, StringConstraints(pattern=r"^https://[^\s/]+(/\S*)?$")]


class Recruitment(Part):
    """How participants are recruited, and how they return to the platform."""

    platform: Literal["none", "prolific", "connect", "sona", "mturk", "other"] = Field(
        default="none", description="none, prolific, connect, sona, mturk or other"
    )
    # Left out of a plan's data where not given, so that the hashes of earlier plans stay valid.
    parameters: tuple[ParameterName, ...] = Field(
        default=(),
        max_length=5,
        exclude_if=lambda names: not names,
        description="for other, a list of up to 5 names of the link's parameters, that of the"
        " person first, such as [ResponseID]",
    )
    parameter: StrictStr = Field(
        default="survey_code",
        pattern=r"^[A-Za-z][A-Za-z0-9_]{0,39}$",
        description="for sona, the name of the parameter that carries %SURVEY_CODE%",
    )
    codes: dict[Outcome, Code] = Field(
        default_factory=dict,
        description=f"a mapping of completed, screened_out, declined, withdrawn or technical to"
        f" {_CODE_FORM}",
    )
    return_urls: dict[Outcome, Address] = Field(
        default_factory=dict,
        description="a mapping of completed, screened_out, declined, withdrawn or technical to"
        " an address that begins with https://",
    )
    return_url: Address | None = Field(
        default=None,
        exclude_if=absent,
        description="for other, an address that begins with https://, with {name} where the value"
        " of a parameter belongs",
    )
    links: Literal["open", "single-use"] = Field(default="open", description="open or single-use")
    returning: Literal["resume", "block", "again"] = Field(
        default="resume", description="resume, block or again"
    )
    signed_links: StrictBool = Field(
        default=False,
        # Plans that do not want it keep the hash that they had before there was such a thing.
        exclude_if=lambda wanted: not wanted,
        description="true or false: whether only links that the platform has signed let people in",
    )

    @property
    def link_parameters(self) -> tuple[str, ...]:
        """The parameters of a link that are kept. Without a platform none is: it would serve for
        nothing, and the privacy page would not name it.
        """
        if self.platform == "sona":
            return (self.parameter,)
        if self.platform == OTHER:
            return self.parameters
        if self.platform == NO_PLATFORM:
            return ()
        return PLATFORMS[self.platform].parameters

    @property
    def takes_each_once(self) -> bool:
        """Whether returning participants are recognised and refused."""
        return self.returning == "block" and self.platform != NO_PLATFORM

    @property
    def label(self) -> str | None:
        """The platform's name for people; of one that the studio does not know, its host."""
        if self.platform == OTHER:
            return urlsplit(self.return_url or next(iter(self.return_urls.values()), "")).netloc
        return PLATFORMS[self.platform].label if self.platform in PLATFORMS else None


@dataclass(frozen=True)
class WayBack:
    """The completion code and return link; with `fields`, they are sent to `url` as a form."""

    code: str | None
    url: str | None
    fields: Mapping[str, str] = field(default_factory=dict)


def study_link(platform: str, address: str, parameters: Sequence[str]) -> str:
    """The study's link for a platform, with the placeholders that the platform fills in.

    Connect and Mechanical Turk add their parameters to a plain link themselves.
    """
    match platform:
        case "prolific":
            names = PLATFORMS[platform].parameters
            return address + "?" + "&".join(f"{name}={{{{%{name}%}}}}" for name in names)
        case "sona":
            return f"{address}?{parameters[0]}=%SURVEY_CODE%"
        case "other":
            return address + "?" + "&".join(f"{name}=${{{name}}}" for name in parameters)
        case _:
            return address


def read(recruitment: Recruitment, came: Iterable[tuple[str, str]]) -> Given:
    """What may be kept of the parameters that came: the platform's own, and none besides.

    Raises UnreadableIdError.
    """
    given = identifiers.read(recruitment.link_parameters, came)
    ids = dict(given.ids)
    if "turkSubmitTo" in ids and _submit_address(ids["turkSubmitTo"]) is None:
        del ids["turkSubmitTo"]
    return Given(ids, given.unfilled)


def kept(recruitment: Recruitment, given: Mapping[str, str]) -> Mapping[str, str]:
    """The same of parameters of which each came once."""
    return read(recruitment, given.items()).ids


def person(recruitment: Recruitment, ids: Mapping[str, str]) -> tuple[str, str] | None:
    """The parameter that identifies the person, and its value; None without one."""
    if recruitment.platform == NO_PLATFORM:
        return None
    known = PLATFORMS.get(recruitment.platform)
    key = (known.person if known else "") or recruitment.link_parameters[0]
    return (key, ids[key]) if ids.get(key) else None


def submission(recruitment: Recruitment, ids: Mapping[str, str]) -> tuple[str, str] | None:
    """The parameter that names the submission, and the name; None where there is none."""
    if recruitment.platform not in PLATFORMS:
        return None
    key = PLATFORMS[recruitment.platform].submission
    return (key, ids[key]) if key is not None and ids.get(key) else None


def is_mturk_preview(recruitment: Recruitment, given: Mapping[str, str]) -> bool:
    """Whether this is a preview of the task on Mechanical Turk, before it is accepted."""
    return recruitment.platform == "mturk" and given.get("assignmentId") == _NOT_ACCEPTED


def way_back(recruitment: Recruitment, outcome: Outcome, ids: Mapping[str, str]) -> WayBack | None:
    """The completion code and return link for this outcome and these ids; None without either."""
    code = recruitment.codes.get(outcome)
    url = recruitment.return_urls.get(outcome)
    if outcome == "withdrawn":
        # Both say that no finished session is to be expected.
        code = code or recruitment.codes.get("declined")
        url = url or recruitment.return_urls.get("declined")
    url = url or recruitment.return_url
    fields: dict[str, str] = {}
    match recruitment.platform:
        case "prolific" if code is not None:
            url = f"https://app.prolific.com/submissions/complete?cc={quote(code, safe='')}"
        case "connect" if outcome == "completed" and url is None:
            project = ids.get("projectId", "")
            if _PLAIN_ID.fullmatch(project):
                url = f"https://connect.cloudresearch.com/participant/project/{project}/complete"
        case "sona" if outcome == "completed" and url is not None:
            url = _with_survey_code(url, ids.get(recruitment.parameter))
        case "other" if url is not None:
            url = _with_ids(url, ids)
        case "mturk" if outcome == "completed":
            url = _submit_address(ids.get("turkSubmitTo", ""))
            assignment = ids.get("assignmentId", "")
            if _PLAIN_ID.fullmatch(assignment) and url is not None:
                # Besides the assignment at least one more field is expected.
                fields = {"assignmentId": assignment, "code": code or "completed"}
            else:
                url = None
    return None if code is None and url is None else WayBack(code, url, fields)


def disagreements(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    """Contradictions within the plan's `recruitment`, given as plain data."""
    said = as_mapping(plan.get("recruitment"))
    platform = said.get("platform", NO_PLATFORM)
    place = ("recruitment",)
    if platform == "prolific" and "completed" not in as_mapping(said.get("codes")):
        message = "expected a code for completed: Prolific's way back is made of it"
        yield Inconsistency((*place, "codes"), message)
    if platform == "sona" and "completed" not in as_mapping(said.get("return_urls")):
        message = "expected an address for completed: SONA's client-side completion URL"
        yield Inconsistency((*place, "return_urls"), message)
    if platform in ("prolific", "mturk") and as_mapping(said.get("return_urls")):
        message = f"expected none for platform {platform}, which makes its own"
        yield Inconsistency((*place, "return_urls"), message)
    if platform != NO_PLATFORM and said.get("links", "open") != "open":
        message = f"expected open for platform {platform}, whose link is the same for everybody"
        yield Inconsistency((*place, "links"), message)
    if platform != "prolific" and said.get("signed_links", False) is not False:
        message = f"expected it for platform prolific alone, got platform {platform}"
        yield Inconsistency((*place, "signed_links"), message)
    yield from _of_other(place, said, platform)
    default = Recruitment.model_fields["parameter"].default
    if platform != "sona" and said.get("parameter", default) != default:
        message = f"expected it for platform sona alone, got platform {platform}"
        yield Inconsistency((*place, "parameter"), message)


def _of_other(
    place: Place, said: Mapping[str, object], platform: object
) -> Iterator[Inconsistency]:
    """Parameters of one's own, and the places for them in the addresses back."""
    names = [name for name in as_list(said.get("parameters")) if isinstance(name, str)]
    if platform == OTHER and not names:
        message = "expected the names of the link's parameters, that of the person first, got none"
        yield Inconsistency((*place, "parameters"), message)
    if platform != OTHER and said.get("return_url") is not None:
        message = f"expected it for platform other alone, got platform {platform}"
        yield Inconsistency((*place, "return_url"), message)
    if platform == OTHER and not (said.get("return_url") or said.get("return_urls")):
        message = "expected the address that people go back to, got none"
        yield Inconsistency((*place, "return_url"), message)
    if platform != OTHER and names:
        message = f"expected it for platform other alone, got platform {platform}"
        yield Inconsistency((*place, "parameters"), message)
    urls: dict[Place, object] = {("return_url",): said.get("return_url")}
    urls |= {("return_urls", key): url for key, url in as_mapping(said.get("return_urls")).items()}
    for where, url in urls.items():
        if platform != OTHER or not isinstance(url, str):
            continue
        for name in _PLACE.findall(url):
            if name not in names:
                message = f"expected one of the parameters in braces ({', '.join(names)})"
                yield Inconsistency((*place, *where), f"{message}, got {name!r}")
        if "{" in url.removeprefix("https://").split("/")[0]:
            message = "expected a parameter after the host's name only, got one within it"
            yield Inconsistency((*place, *where), message)


def _with_survey_code(url: str, survey_code: str | None) -> str | None:
    """SONA's address with this person's code; without a code it would grant no credit."""
    if survey_code is None or not _PLAIN_ID.fullmatch(survey_code):
        return None
    parts = urlsplit(url)
    others = [pair for pair in parse_qsl(parts.query) if pair[0] != "survey_code"]
    return urlunsplit(parts._replace(query=urlencode([*others, ("survey_code", survey_code)])))


def _with_ids(url: str, ids: Mapping[str, str]) -> str | None:
    """The address with each {name} as the value that came; None where one did not come."""
    if any(name not in ids for name in _PLACE.findall(url)):
        return None
    return _PLACE.sub(lambda place: quote(ids[place[1]], safe=""), url)


def _submit_address(turk_submit_to: str) -> str | None:
    """Where Mechanical Turk takes the result, if the link names one of its own hosts."""
    try:
        parts = urlsplit(turk_submit_to)
        is_its_own = parts.scheme == "https" and parts.netloc in MTURK_HOSTS
    except ValueError:
        return None
    return f"https://{parts.netloc}/mturk/externalSubmit" if is_its_own else None


def described(
    recruitment: Recruitment, outcome: Outcome, ids: Mapping[str, str] | None = None
) -> dict[str, Any] | None:
    """The code and the way back as a page and the API say it; None if there is neither."""
    found = way_back(recruitment, outcome, ids or {})
    if found is None:
        return None
    described: dict[str, Any] = {
        "code": found.code,
        "url": found.url,
        "platform": recruitment.label,
    }
    if found.fields:
        described["fields"] = dict(found.fields)
    return described
