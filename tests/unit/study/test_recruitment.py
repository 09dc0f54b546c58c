"""Recruitment platforms: what is kept of a link, and the way back."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.study.recruitment import (
    MTURK_HOSTS,
    Recruitment,
    WayBack,
    is_mturk_preview,
    kept,
    person,
    way_back,
)

Edit = Callable[[Path, str, str], None]
Faults = Callable[[Path], list[str]]

CODES = {
    "completed": "C1",
    "screened_out": "S2",
    "declined": "D3",
    "withdrawn": "W4",
    "technical": "T5",
}
PROLIFIC = Recruitment.model_validate({"platform": "prolific", "codes": CODES})
CONNECT = Recruitment.model_validate({"platform": "connect", "codes": {"completed": "C1"}})
CREDIT = "https://school.sona-systems.com/webstudy_credit.aspx?experiment_id=12&credit_token=9f4e"
SONA = Recruitment.model_validate(
    {"platform": "sona", "return_urls": {"completed": f"{CREDIT}&survey_code=XXXX"}}
)
MTURK = Recruitment.model_validate({"platform": "mturk", "codes": {"completed": "C1"}})
SANDBOX = "https://workersandbox.mturk.com"


@pytest.mark.parametrize("outcome", list(CODES))
def test_prolific_has_a_code_and_an_address_for_each_outcome(outcome: Any) -> None:
    address = f"https://app.prolific.com/submissions/complete?cc={CODES[outcome]}"
    assert way_back(PROLIFIC, outcome, {}) == WayBack(CODES[outcome], address)


def test_an_outcome_without_a_code_has_no_way_back_and_withdrawn_takes_that_of_declined() -> None:
    few = Recruitment.model_validate(
        {"platform": "prolific", "codes": {"completed": "C1", "declined": "D3"}}
    )
    assert way_back(few, "screened_out", {}) is None
    assert way_back(few, "withdrawn", {}) == way_back(few, "declined", {})
    assert way_back(Recruitment(), "completed", {}) is None


def test_connect_leads_back_to_the_project_that_the_link_named() -> None:
    found = way_back(CONNECT, "completed", {"projectId": "76e70db4"})
    address = "https://connect.cloudresearch.com/participant/project/76e70db4/complete"
    assert found == WayBack("C1", address)


@pytest.mark.parametrize("project", ["", "../../login", "a/b", "a?b", "x" * 65])
def test_connect_makes_no_address_of_what_is_no_id(project: str) -> None:
    assert way_back(CONNECT, "completed", {"projectId": project}) == WayBack("C1", None)


def test_connect_uses_the_address_that_the_plan_gives() -> None:
    own = "https://connect.cloudresearch.com/participant/project/AB/complete"
    plan = Recruitment.model_validate({"platform": "connect", "return_urls": {"completed": own}})
    assert way_back(plan, "completed", {"projectId": "CD"}) == WayBack(None, own)


def test_sona_grants_credit_to_the_survey_code_of_the_link_and_to_no_other() -> None:
    assert way_back(SONA, "completed", {"survey_code": "4711"}) == WayBack(
        None, f"{CREDIT}&survey_code=4711"
    )
    assert way_back(SONA, "completed", {}) is None
    assert way_back(SONA, "completed", {"survey_code": "1&credit_token=2"}) is None
    assert way_back(SONA, "withdrawn", {"survey_code": "4711"}) is None


def test_sonas_code_comes_in_the_parameter_that_the_study_chose() -> None:
    plan = SONA.model_copy(update={"parameter": "id"})
    assert kept(plan, {"id": "4711", "survey_code": "1"}) == {"id": "4711"}
    found = way_back(plan, "completed", {"id": "4711"})
    assert found is not None
    assert found.url == f"{CREDIT}&survey_code=4711"


@pytest.mark.parametrize("host", MTURK_HOSTS)
def test_mturk_takes_a_form_at_the_host_that_the_link_named(host: str) -> None:
    ids = {"turkSubmitTo": f"https://{host}/", "assignmentId": "A1"}
    assert way_back(MTURK, "completed", ids) == WayBack(
        "C1", f"https://{host}/mturk/externalSubmit", {"assignmentId": "A1", "code": "C1"}
    )


@pytest.mark.parametrize(
    "elsewhere",
    [
        "https://evil.example",
        "http://www.mturk.com",
        "https://www.mturk.com.evil.example",
        "https://www.mturk.com@evil.example",
        "https://www.mturk.com:8443",
        "https://[",
        "javascript:alert(1)",
        "//www.mturk.com",
    ],
)
def test_mturk_sends_nobody_anywhere_else(elsewhere: str) -> None:
    ids = {"turkSubmitTo": elsewhere, "assignmentId": "A1", "workerId": "W"}
    assert way_back(MTURK, "completed", ids) == WayBack("C1", None)
    assert kept(MTURK, ids) == {"assignmentId": "A1", "workerId": "W"}


@given(st.text())
def test_a_form_goes_to_mturk_or_nowhere(address: str) -> None:
    found = way_back(MTURK, "completed", {"turkSubmitTo": address, "assignmentId": "A1"})
    assert found is not None
    assert found.url in {None, *(f"https://{host}/mturk/externalSubmit" for host in MTURK_HOSTS)}


def test_a_task_that_was_not_accepted_is_a_preview() -> None:
    assert is_mturk_preview(MTURK, {"assignmentId": "ASSIGNMENT_ID_NOT_AVAILABLE"})
    assert not is_mturk_preview(MTURK, {"assignmentId": "A1"})
    assert not is_mturk_preview(CONNECT, {"assignmentId": "ASSIGNMENT_ID_NOT_AVAILABLE"})


LINK = {
    "PROLIFIC_PID": "p",
    "STUDY_ID": "s",
    "SESSION_ID": "x",
    "participantId": "c",
    "assignmentId": "a",
    "projectId": "j",
    "workerId": "w",
    "hitId": "h",
    "turkSubmitTo": SANDBOX,
    "survey_code": "1",
    "utm_source": "mail",
    "email": "me@example.org",
}


@pytest.mark.parametrize(
    ("plan", "names"),
    [
        (PROLIFIC, {"PROLIFIC_PID", "STUDY_ID", "SESSION_ID"}),
        (CONNECT, {"participantId", "assignmentId", "projectId"}),
        (SONA, {"survey_code"}),
        (MTURK, {"workerId", "assignmentId", "hitId", "turkSubmitTo"}),
        (Recruitment(), set()),
    ],
)
def test_only_a_platforms_own_parameters_are_kept(plan: Recruitment, names: set[str]) -> None:
    assert kept(plan, LINK).keys() == names
    assert kept(plan, dict.fromkeys(LINK, "")) == {}


# In study.yaml


def recruitment(folder: Path, edit: Edit, text: str) -> None:
    edit(folder / "study.yaml", "queries_per_trial: 4\n", f"queries_per_trial: 4\n{text}\n")


@pytest.mark.parametrize(
    "text",
    [
        "recruitment: {platform: prolific, codes: {completed: C1, declined: D2}}",
        "recruitment: {platform: connect}",
        "recruitment: {platform: mturk, codes: {completed: C1}}",
        "recruitment: {codes: {completed: C1}, return_urls: {completed: https://lab.example/x}}",
        f"recruitment: {{platform: sona, parameter: id, return_urls: {{completed: '{CREDIT}'}}}}",
    ],
)
def test_recruitment_that_agrees_has_no_fault(
    folder: Path, edit: Edit, faults: Faults, text: str
) -> None:
    recruitment(folder, edit, text)
    assert faults(folder) == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "recruitment: {platform: facebook}",
            (
                "recruitment.platform: expected none, prolific, connect, sona, mturk or other,"
                " got 'facebook'"
            ),
        ),
        (
            "recruitment: {platform: prolific, codes: {declined: D}}",
            "recruitment.codes: expected a code for completed: Prolific's way back is made of it",
        ),
        (
            "recruitment: {platform: sona}",
            (
                "recruitment.return_urls: expected an address for completed:"
                " SONA's client-side completion URL"
            ),
        ),
        (
            "recruitment: {platform: mturk, return_urls: {completed: https://a.example/}}",
            "recruitment.return_urls: expected none for platform mturk, which makes its own",
        ),
        (
            "recruitment: {platform: connect, parameter: id}",
            "recruitment.parameter: expected it for platform sona alone, got platform connect",
        ),
        (
            "recruitment: {platform: connect, links: single-use}",
            (
                "recruitment.links: expected open for platform connect, whose link is the same for"
                " everybody"
            ),
        ),
        (
            "recruitment: {codes: {finished: C1}}",
            (
                "recruitment.codes.finished: expected a mapping of completed, screened_out,"
                " declined, withdrawn or technical to a code of up to 60 letters, digits, - and _,"
                " got the name 'finished'"
            ),
        ),
        (
            "recruitment: {codes: {completed: 'a b'}}",
            (
                "recruitment.codes.completed: expected a mapping of completed, screened_out,"
                " declined, withdrawn or technical to a code of up to 60 letters, digits, - and _,"
                " got 'a b'"
            ),
        ),
        (
            "recruitment: {return_urls: {completed: 'http://a.example'}}",
            (
                "recruitment.return_urls.completed: expected a mapping of completed, screened_out,"
                " declined, withdrawn or technical to an address that begins with https://,"
                " got 'http://a.example'"
            ),
        ),
    ],
)
def test_a_fault_in_the_recruitment_is_named(
    folder: Path, edit: Edit, faults: Faults, text: str, expected: str
) -> None:
    recruitment(folder, edit, text)
    assert faults(folder) == [f"study.yaml:20: {expected}"]


OTHER = Recruitment.model_validate(
    {
        "platform": "other",
        "parameters": ["ResponseID", "batch"],
        "return_url": "https://lab.qualtrics.com/jfe/form/SV_1?id={ResponseID}&b={batch}",
        "return_urls": {"declined": "https://lab.qualtrics.com/no"},
    }
)


def test_another_site_has_its_own_parameters_and_gets_them_back() -> None:
    ids = kept(OTHER, {"responseid": "R_1 &x", "batch": "7", "utm": "mail"})
    assert ids == {"ResponseID": "R_1 &x", "batch": "7"}
    assert person(OTHER, ids) == ("ResponseID", "R_1 &x")
    way = way_back(OTHER, "completed", ids)
    assert way == WayBack(None, "https://lab.qualtrics.com/jfe/form/SV_1?id=R_1%20%26x&b=7")
    assert way_back(OTHER, "completed", {"batch": "7"}) is None
    assert way_back(OTHER, "withdrawn", {}) == WayBack(None, "https://lab.qualtrics.com/no")
    assert OTHER.label == "lab.qualtrics.com"


@pytest.mark.parametrize(
    ("recruitment", "expected"),
    [
        ("{platform: other, return_url: 'https://a.example/'}", "recruitment.parameters: expected"),
        ("{platform: other, parameters: [id]}", "recruitment.return_url: expected the address"),
        (
            "{platform: other, parameters: [id], return_url: 'https://a.example/?i={ID}'}",
            "expected one of the parameters in braces (id), got 'ID'",
        ),
        (
            "{platform: other, parameters: [id], return_url: 'https://{id}.example/'}",
            "expected a parameter after the host's name only",
        ),
        ("{parameters: [id]}", "expected it for platform other alone, got platform none"),
    ],
)
def test_what_another_site_lacks_is_named(
    folder: Path, edit: Edit, faults: Faults, recruitment: str, expected: str
) -> None:
    text = f"queries_per_trial: 4\nrecruitment: {recruitment}"
    edit(folder / "study.yaml", "queries_per_trial: 4", text)
    assert expected in "\n".join(faults(folder))
