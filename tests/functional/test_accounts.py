"""Accounts over HTTP: inviting, choosing a password, roles, disabling; and the same by command."""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest
from sqlalchemy import text

from app.services.accounts import accounts, administration, audit_log, invitations
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, InvitationError
from tests.conftest import Clock, database_file

from .client import Api
from .conftest import EMAIL, PASSWORD
from .test_commands import Run, mistake, pbpo
from .test_experimenter_pages import form_token, sign_in

__all__ = ["pbpo"]

BOB = "bob@lab.example"
NEW_PASSWORD = "a horse that is correct"


@pytest.fixture
def admin(client: Api, api_token: str) -> Api:
    """Ada, an admin, is signed in."""
    assert sign_in(client).status_code == 303
    return client


def send(client: Api, path: str, page: str = "/accounts", **fields: str) -> httpx.Response:
    return client.post(path, data={"csrf_token": form_token(client.get(page)), **fields})


def link_in(page: httpx.Response) -> str:
    found = re.search(r'data-testid="invitation">http://testserver(/invitations/[^<]+)<', page.text)
    assert found, page.text
    return found[1]


def choose(client: Api, link: str, password: str, again: str | None = None) -> httpx.Response:
    given = {"password": password, "again": password if again is None else again}
    return send(client, link, link, **given)


def invited(client: Api, role: str = "experimenter") -> str:
    return link_in(send(client, "/accounts/invite", email=f" {BOB.upper()}", role=role))


def actions(app: AppContext) -> list[str]:
    return [line.action for line in audit_log.trail(app)]


@pytest.mark.parametrize("role", ["experimenter", "reviewer", "admin"])
def test_whoever_is_invited_chooses_a_password_and_has_the_role(
    admin: Api, app: AppContext, role: str
) -> None:
    link = invited(admin, role)
    assert BOB in admin.get("/accounts").text
    assert link not in admin.get("/accounts").text
    admin.cookies.clear()
    assert BOB in admin.get(link).text
    done = choose(admin, link, NEW_PASSWORD)
    assert (done.status_code, NEW_PASSWORD in done.text) == (200, False)
    assert sign_in(admin, BOB, NEW_PASSWORD).status_code == 303
    assert accounts.find(app, BOB).role == role
    assert actions(app)[:3] == ["signed in", "account made", "account invited"]


def test_a_link_lets_one_choose_once(admin: Api) -> None:
    link = invited(admin)
    assert choose(admin, link, NEW_PASSWORD).status_code == 200
    page = admin.get(link)
    assert (page.status_code, "has been used" in page.text) == (410, True)
    again = send(admin, link, "/accounts", password=PASSWORD, again=PASSWORD)
    assert again.status_code == 410
    admin.cookies.clear()
    assert sign_in(admin, BOB, PASSWORD).status_code == 401


def test_two_who_use_a_link_at_once_make_one_account(app: AppContext, api_token: str) -> None:
    token = invitations.invite(app, BOB, Role.EXPERIMENTER, EMAIL).rsplit("/", 1)[1]

    def accept(number: int) -> bool:
        try:
            invitations.accept(app, token, f"{NEW_PASSWORD} {number}")
        except InvitationError:
            return False
        return True

    with ThreadPoolExecutor(4) as pool:
        assert sorted(pool.map(accept, range(4))) == [False, False, False, True]


def test_a_link_is_good_for_seven_days(admin: Api, clock: Clock) -> None:
    link = invited(admin)
    clock.forward(7 * 24 * 3600 - 1)
    assert admin.get(link).status_code == 200
    clock.forward(1)
    page = admin.get(link)
    assert (page.status_code, "another one" in page.text) == (410, True)


def test_a_link_that_nobody_was_given_says_so(client: Api) -> None:
    page = client.get("/invitations/made-up")
    assert (page.status_code, "Nobody was given this link" in page.text) == (410, True)


def test_passwords_that_cannot_be_taken_leave_the_link_as_it_was(admin: Api) -> None:
    link = invited(admin)
    for password, again, said in [
        ("short", "short", "at least 10 characters"),
        (NEW_PASSWORD, PASSWORD, "not the same"),
    ]:
        page = choose(admin, link, password, again)
        assert (page.status_code, said in page.text) == (409, True)
    without_token = admin.post(link, data={"password": NEW_PASSWORD, "again": NEW_PASSWORD})
    assert without_token.status_code == 422
    assert choose(admin, link, NEW_PASSWORD).status_code == 200


def test_a_newer_link_and_taking_it_back_make_the_earlier_worthless(admin: Api) -> None:
    first, second = invited(admin), invited(admin)
    assert admin.get(first).status_code == 410
    take_back = re.search(r"/accounts/invitations/\d+/take-back", admin.get("/accounts").text)
    assert take_back is not None
    assert send(admin, take_back[0]).status_code == 303
    assert admin.get(second).status_code == 410
    assert send(admin, take_back[0]).status_code == 404


@pytest.mark.sqlite
def test_links_are_kept_as_hashes(admin: Api, app: AppContext) -> None:
    secret = invited(admin).rsplit("/", 1)[1].encode()
    file = database_file(app.settings)
    for path in (file, file.with_name(f"{file.name}-wal")):
        assert secret not in path.read_bytes()


@pytest.mark.parametrize("address", ["", "nobody", "@lab", "a b@lab.example", "a@b@c", EMAIL])
def test_an_address_that_cannot_be_invited_is_named(admin: Api, address: str) -> None:
    page = send(admin, "/accounts/invite", email=address, role="reviewer")
    # An empty field is one that did not come.
    assert page.status_code == (409 if address else 422)
    assert not re.search(r"/invitations/[\w-]{20}", page.text)


def test_a_reset_link_changes_the_password_and_signs_everybody_out(
    admin: Api, app: AppContext
) -> None:
    accounts.create(app, BOB, PASSWORD)
    cookie = accounts.sign_in(app, BOB, PASSWORD)
    link = link_in(send(admin, "/accounts/reset", email=BOB))
    assert accounts.by_sign_in(app, cookie).email == BOB
    assert choose(admin, link, NEW_PASSWORD).status_code == 200
    admin.cookies.clear()
    admin.cookies.set("pbpo_sign_in", cookie)
    assert admin.get("/studies").status_code == 303
    admin.cookies.clear()
    assert sign_in(admin, BOB, PASSWORD).status_code == 401
    assert sign_in(admin, BOB, NEW_PASSWORD).status_code == 303
    assert accounts.find(app, BOB).role == "experimenter"


def test_a_disabled_account_is_out_at_once_and_its_owner_can_be_let_in_again(
    admin: Api, app: AppContext
) -> None:
    bob = accounts.create(app, BOB, PASSWORD)
    token = accounts.create_api_token(app, bob, "mine")
    cookie = accounts.sign_in(app, BOB, PASSWORD)
    reset_link = link_in(send(admin, "/accounts/reset", email=BOB))
    assert send(admin, "/accounts/disable", email=BOB).status_code == 303
    assert admin.get(reset_link).status_code == 410
    assert "disabled" in admin.get("/accounts").text
    assert send(admin, "/accounts/reset", email=BOB).status_code == 409
    admin.cookies.clear()
    admin.cookies.set("pbpo_sign_in", cookie)
    assert admin.get("/studies").status_code == 303
    bearer = {"Authorization": f"Bearer {token}"}
    assert admin.get("/studies", headers=bearer).status_code == 303
    admin.cookies.clear()
    assert sign_in(admin, BOB, PASSWORD).status_code == 401
    administration.enable(app, BOB, EMAIL)
    assert sign_in(admin, BOB, PASSWORD).status_code == 303


@pytest.mark.parametrize("action", [{}, {"role": "reviewer"}, {"role": "experimenter"}])
def test_the_last_admin_stays_one(admin: Api, app: AppContext, action: dict[str, str]) -> None:
    path = "/accounts/role" if action else "/accounts/disable"
    accounts.create(app, BOB, PASSWORD, Role.EXPERIMENTER)
    page = send(admin, path, email=EMAIL, **action)
    assert (page.status_code, "the last one" in page.text) == (409, True)
    administration.change_role(app, BOB, Role.ADMIN, EMAIL)
    assert send(admin, path, email=EMAIL, **action).status_code == 303
    assert accounts.find(app, BOB).role == "admin"


def test_a_disabled_admin_does_not_count_as_another(app: AppContext, api_token: str) -> None:
    accounts.create(app, BOB, PASSWORD, Role.ADMIN)
    administration.disable(app, BOB, EMAIL)
    with pytest.raises(ConflictError, match="the last one"):
        administration.disable(app, EMAIL, EMAIL)


def test_the_trail_tells_who_did_what_and_is_read_by_admins(admin: Api, app: AppContext) -> None:
    accounts.create(app, BOB, PASSWORD)
    send(admin, "/accounts/role", email=BOB, role="reviewer")
    line = audit_log.trail(app)[0]
    assert (line.actor, line.action) == (EMAIL, "role changed")
    assert line.details == {"account": BOB, "before": "experimenter", "after": "reviewer"}
    page = admin.get("/activity").text
    assert "role changed" in page
    assert "before: experimenter; after: reviewer" in page
    older = admin.get("/activity", params={"before": line.id}).text
    assert "role changed" not in older
    assert "signed in" in older


def test_the_trail_is_read_in_pieces(admin: Api, app: AppContext) -> None:
    for number in range(150):
        audit_log.note_alone(app, EMAIL, "counted", number=number)
    first = admin.get("/activity").text
    assert first.count("<tr>") == 101
    older = re.search(r'href="(\?before=\d+)">Older', first)
    assert older is not None
    second = admin.get(f"/activity{older[1]}").text
    told = [int(found) for found in re.findall(r"number: (\d+)<", first + second)]
    assert told == list(range(149, -1, -1))


def test_nothing_in_the_trail_can_be_changed(app: AppContext, api_token: str) -> None:
    for statement in ("DELETE FROM audit_events", "UPDATE audit_events SET actor = 'nobody'"):
        with pytest.raises(Exception, match="append-only"), app.database.write() as db:
            db.execute(text(statement))


def test_commands_invite_reset_list_disable_and_give_roles(
    pbpo: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = pbpo("account", "invite", BOB, "--role", "admin", "--address", "https://lab.example/")
    assert re.fullmatch(r"https://lab\.example/invitations/[\w-]{43}\n", link.out)
    monkeypatch.setattr("typer.prompt", lambda *_, **__: PASSWORD)
    assert "as admin" in pbpo("account", "create", EMAIL).out
    assert "as reviewer" in pbpo("account", "create", BOB, "--role", "reviewer").out
    assert pbpo("account", "reset", BOB).out.startswith("/invitations/")
    assert pbpo("account", "role", BOB, "admin").out == f"{BOB} is admin now.\n"
    assert "is disabled" in pbpo("account", "disable", BOB).out
    assert re.search(rf"{BOB} +admin +\d{{4}}-\d\d-\d\d +\d{{4}}", pbpo("account", "list").out)
    assert "the last one" in mistake(pbpo("account", "disable", EMAIL))
    assert "the last one" in mistake(pbpo("account", "role", EMAIL, "reviewer"))
    assert "can sign in again" in pbpo("account", "enable", BOB).out
    assert "no account" in mistake(pbpo("account", "reset", "nobody@lab.example"))
    assert "has an account" in mistake(pbpo("account", "invite", BOB))
    assert "captain" in mistake(pbpo("account", "role", BOB, "captain"))
    assert len(pbpo("account", "token", EMAIL, "--scope", "read", "--days", 7).out.strip()) == 43


def test_links_that_go_out_begin_with_the_public_address_whatever_host_was_named(
    admin: Api, app: AppContext, pbpo: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    public = app.settings.model_copy(update={"public_url": "https://studies.lab.example"})
    object.__setattr__(app, "settings", public)
    form = {"csrf_token": form_token(admin.get("/accounts")), "email": BOB, "role": "reviewer"}
    page = admin.post("/accounts/invite", data=form, headers={"Host": "evil.example"})
    assert re.search(r">https://studies\.lab\.example/invitations/[\w-]{43}<", page.text)
    assert "evil.example" not in page.text


def test_commands_say_whole_addresses_where_the_studio_knows_its_own(
    pbpo: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    without = pbpo("account", "invite", BOB)
    assert without.out.startswith("/invitations/")
    assert "set PBPO_PUBLIC_URL" in without.err
    monkeypatch.setenv("PBPO_PUBLIC_URL", "https://studies.lab.example/")
    link = pbpo("account", "invite", "carol@lab.example")
    assert re.fullmatch(r"https://studies\.lab\.example/invitations/[\w-]{43}\n", link.out)
    assert "Send carol@lab.example this link. Within 7 days" in link.err
    monkeypatch.setenv("PBPO_PUBLIC_URL", "https://studies.lab.example/pbpo")
    assert "without a path" in mistake(pbpo("account", "invite", BOB))
