"""What experimenters do at the same moment: one after the other, or one of them is told."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait

import pytest
from sqlalchemy.exc import IntegrityError

from app.services.accounts import accounts, audit_log, invitations
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.sessions import advance
from app.services.studies import repository, revision, sharing
from app.services.studies.repository import StudyInfo
from app.storage.models.accounts import Account
from tests.conftest import Clock

from .client import Api
from .conftest import EMAIL, PASSWORD
from .test_accounts import BOB, choose
from .test_participant_pages import heading, in_browser


def held_together(app: AppContext, *both: Callable[[], object]) -> None:
    """Do both while somebody else holds the study: neither goes on before it is let go."""
    with ThreadPoolExecutor(len(both)) as threads:
        with app.database.write() as db:
            repository.lock_study(db, "short")
            begun = [threads.submit(one) for one in both]
            wait(begun, timeout=0.3)
        for one in begun:
            one.result(20)


def test_texts_revised_twice_at_once_are_two_versions(
    app: AppContext, short_study: StudyInfo
) -> None:
    def revised(debrief: str) -> Callable[[], object]:
        texts = {"en": {**short_study.texts["en"], "debrief": debrief}}
        return lambda: revision.revise_texts(app, "short", texts, EMAIL)

    held_together(app, revised("One thank you.\n"), revised("Another thank you.\n"))
    assert [one.version for one in revision.versions(app, short_study)] == [3, 2, 1]


def test_a_study_shared_twice_at_once_is_shared(app: AppContext, short_study: StudyInfo) -> None:
    accounts.create(app, EMAIL, PASSWORD)
    accounts.create(app, BOB, PASSWORD)
    held_together(app, *[lambda: sharing.share(app, "short", BOB, EMAIL)] * 2)
    assert [tie.email for tie in sharing.members(app, "short")] == [BOB]
    done = [line.action for line in audit_log.trail(app)]
    assert done.count("study shared") == 1


def test_who_comes_second_is_told_so_and_the_log_names_nobody(
    client: Api,
    app: AppContext,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    link = invitations.invite(app, BOB, Role.EXPERIMENTER, EMAIL)
    accounts.create(app, BOB, PASSWORD)
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
    app: AppContext,
    short_study: StudyInfo,
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    in_browser(client, "instructions", clock)

    def second(*_: object, **__: object) -> None:
        accounts.create(app, EMAIL, PASSWORD)
        write_account(app, "admin")

    monkeypatch.setattr(advance, "continue_session", second)
    page = client.post("/s/short/continue")
    assert (page.status_code, heading(page)) == (409, "That is not possible now")
    assert "open the study&#39;s link again" in page.text


def test_any_other_broken_rule_is_a_fault_of_ours(
    client: Api,
    app: AppContext,
    short_study: StudyInfo,
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    in_browser(client, "instructions", clock)
    monkeypatch.setattr(advance, "continue_session", lambda *_, **__: write_account(app, "emperor"))
    assert client.post("/s/short/continue").status_code == 500
    assert "IntegrityError" in caplog.text
    assert EMAIL not in caplog.text


@pytest.mark.parametrize("role", ["admin", "emperor"])
def test_the_database_refuses_a_row_without_repeating_it(app: AppContext, role: str) -> None:
    accounts.create(app, EMAIL, PASSWORD)
    with pytest.raises(IntegrityError) as caught:
        write_account(app, role)
    told = "".join(traceback.format_exception(caught.value))
    assert "accounts" in str(caught.value.orig)
    assert EMAIL not in told


def write_account(app: AppContext, role: str) -> None:
    with app.database.write() as db:
        db.add(Account(email=EMAIL, password_hash="none", role=role, created_at=app.now()))
