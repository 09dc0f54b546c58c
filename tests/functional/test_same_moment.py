"""What experimenters do at the same moment: one after the other, or one of them is told."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait

import pytest
from sqlalchemy.exc import IntegrityError

from app.services import accounts, audit, invitations, participation, revision, sharing, studies
from app.services.accounts import Role
from app.services.studies import StudyInfo
from app.services.studio import Studio
from app.storage.accounts import Account
from tests.conftest import Clock

from .client import Api
from .conftest import EMAIL, PASSWORD
from .test_accounts import BOB, choose
from .test_participant_pages import heading, in_browser


def held_together(studio: Studio, *both: Callable[[], object]) -> None:
    """Do both while somebody else holds the study: neither goes on before it is let go."""
    with ThreadPoolExecutor(len(both)) as threads:
        with studio.database.write() as session:
            studies.to_change(session, "short")
            begun = [threads.submit(one) for one in both]
            wait(begun, timeout=0.3)
        for one in begun:
            one.result(20)


def test_texts_revised_twice_at_once_are_two_versions(
    studio: Studio, short_study: StudyInfo
) -> None:
    def revised(debrief: str) -> Callable[[], object]:
        texts = {"en": {**short_study.texts["en"], "debrief": debrief}}
        return lambda: revision.revise_texts(studio, "short", texts, EMAIL)

    held_together(studio, revised("One thank you.\n"), revised("Another thank you.\n"))
    assert [one.version for one in revision.versions(studio, short_study)] == [3, 2, 1]


def test_a_study_shared_twice_at_once_is_shared(studio: Studio, short_study: StudyInfo) -> None:
    accounts.create(studio, EMAIL, PASSWORD)
    accounts.create(studio, BOB, PASSWORD)
    held_together(studio, *[lambda: sharing.share(studio, "short", BOB, EMAIL)] * 2)
    assert [tie.email for tie in sharing.ties(studio, "short")] == [BOB]
    done = [line.action for line in audit.trail(studio)]
    assert done.count("study shared") == 1


def test_who_comes_second_is_told_so_and_the_log_names_nobody(
    client: Api,
    studio: Studio,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    link = invitations.invite(studio, BOB, Role.EXPERIMENTER, EMAIL)
    accounts.create(studio, BOB, PASSWORD)
    # As it is for whoever looked before the account was there.
    monkeypatch.setattr(accounts, "by_address", lambda *_: None)
    with caplog.at_level(logging.WARNING):
        refusal = choose(client, link, PASSWORD)
    assert refusal.status_code == 409
    assert "somebody else has just done the same" in refusal.text
    assert "two did the same at once" in caplog.text
    assert "accounts" in caplog.text
    assert BOB not in caplog.text


def test_a_page_of_the_study_that_comes_second_leads_back_in(
    client: Api,
    studio: Studio,
    short_study: StudyInfo,
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    in_browser(client, "instructions", clock)

    def second(*_: object, **__: object) -> None:
        accounts.create(studio, EMAIL, PASSWORD)
        write_account(studio, "admin")

    monkeypatch.setattr(participation, "go_on", second)
    page = client.post("/s/short/continue")
    assert (page.status_code, heading(page)) == (409, "That is not possible now")
    assert "open the study&#39;s link again" in page.text


def test_any_other_broken_rule_is_a_fault_of_ours(
    client: Api,
    studio: Studio,
    short_study: StudyInfo,
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    in_browser(client, "instructions", clock)
    monkeypatch.setattr(participation, "go_on", lambda *_, **__: write_account(studio, "emperor"))
    assert client.post("/s/short/continue").status_code == 500
    assert "IntegrityError" in caplog.text
    assert EMAIL not in caplog.text


@pytest.mark.parametrize("role", ["admin", "emperor"])
def test_the_database_refuses_a_row_without_repeating_it(studio: Studio, role: str) -> None:
    accounts.create(studio, EMAIL, PASSWORD)
    with pytest.raises(IntegrityError) as caught:
        write_account(studio, role)
    told = "".join(traceback.format_exception(caught.value))
    assert "accounts" in str(caught.value.orig)
    assert EMAIL not in told


def write_account(studio: Studio, role: str) -> None:
    with studio.database.write() as session:
        session.add(Account(email=EMAIL, password_hash="none", role=role, created_at=studio.now()))
