"""Links that Prolific signs: whoever comes without one is let in nowhere."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jwt
import pytest
from cryptography.hazmat.primitives.asymmetric import rsa

from app.services.context import AppContext
from app.services.platform_keys import PlatformKeys

from .client import Api
from .conftest import Recruit
from .test_participant_pages import HEADINGS, agree, come_back, heading, sent_on, token_for
from .test_recruitment import PROLIFIC, identities
from .test_returning import in_another_browser, sessions_and_people

SIGNED = f"{PROLIFIC}  signed_links: true\n"
OURS = "https://studies.lab.example"
REFUSED = "That is not possible now"
IDS = {"PROLIFIC_PID": "5f0c", "STUDY_ID": "77", "SESSION_ID": "first"}

Sign = Callable[..., str]


@pytest.fixture(scope="module")
def key() -> rsa.RSAPrivateKey:
    return rsa.generate_private_key(public_exponent=65537, key_size=2048)


@pytest.fixture
def sign(key: rsa.RSAPrivateKey, app: AppContext, tmp_path: Path, recruit: Recruit) -> Sign:
    """Opens a study of signed links; makes links to it, with these claims and names in place."""
    public = json.loads(jwt.algorithms.RSAAlgorithm.to_jwk(key.public_key()))
    file = tmp_path / "jwks.json"
    file.write_text(json.dumps({"keys": [{**public, "kid": "k1", "use": "sig", "alg": "RS256"}]}))
    object.__setattr__(app, "platform_keys", PlatformKeys(str(file)))
    object.__setattr__(app.settings, "public_url", OURS)
    recruit(SIGNED)

    def link(
        ids: dict[str, str] = IDS,
        *,
        signer: rsa.RSAPrivateKey | str = key,
        algorithm: str = "RS256",
        kid: str = "k1",
        **claims: Any,
    ) -> str:
        said = {
            "iss": "https://www.prolific.com",
            "aud": f"{OURS}/s/short",
            "sub": ids.get("SESSION_ID", ""),
            "exp": time.time() + 600,
            "prolific": {**ids, "workspace_id": "w"},
            **claims,
        }
        token = jwt.encode(said, signer, algorithm=algorithm, headers={"kid": kid})
        return f"?prolific_token={token}"

    return link


def test_a_signed_link_lets_its_person_in_and_back(
    client: Api, app: AppContext, sign: Sign
) -> None:
    assert heading(client.get(f"/s/short{sign()}")) == HEADINGS["consent"]
    # What stands in the address besides says nothing.
    sent_on(agree(client, f"{sign()}&PROLIFIC_PID=victim"))
    assert identities(client, token_for(app)) == IDS
    in_another_browser(client)
    sent_on(come_back(client, sign()))
    assert sessions_and_people(app) == (1, 1)


@pytest.mark.parametrize(
    "query",
    ["", "?PROLIFIC_PID=5f0c&SESSION_ID=first", "?prolific_token=", "?prolific_token=a.b.c"],
)
def test_without_a_signature_nobody_is_let_in(
    client: Api, app: AppContext, sign: Sign, query: str
) -> None:
    for answer in (
        client.get(f"/s/short{query}"),
        client.get(f"/s/short/consent{query}"),
        client.post(f"/s/short/consent{query}", data={"version": "0"}),
    ):
        assert (answer.status_code, heading(answer)) == (403, REFUSED)
        assert "Please open it again from your page at Prolific" in answer.text
    api = client.post("/api/v1/studies/short/sessions", json={"external_ids": IDS})
    assert (api.status_code, api.json()["type"]) == (403, "urn:pbpo-studio:problem:signed-link")
    assert sessions_and_people(app) == (0, 0)


@pytest.mark.parametrize(
    "claims",
    [
        {"exp": time.time() - 3600},
        {"iss": "https://elsewhere.example"},
        {"aud": "https://elsewhere.example/s/short"},
        {"aud": f"{OURS}/s/another"},
        {"aud": f"{OURS}.evil.example/s/short"},
        {"prolific": "5f0c"},
        {"prolific": {}},
        {"kid": "k2"},
        {"signer": "a secret of thirty-two letters or more", "algorithm": "HS256"},
        {"signer": rsa.generate_private_key(public_exponent=65537, key_size=2048)},
    ],
)
def test_a_token_that_does_not_hold_is_refused(
    client: Api, app: AppContext, sign: Sign, claims: dict[str, Any]
) -> None:
    page = client.get(f"/s/short{sign(**claims)}")
    assert (page.status_code, heading(page)) == (403, REFUSED)
    assert sessions_and_people(app) == (0, 0)


@pytest.mark.parametrize("audience", [OURS, "studies.lab.example", [f"{OURS}/s/short?x=1"]])
def test_the_audience_may_be_our_host_or_the_studys_address(
    client: Api, sign: Sign, audience: object
) -> None:
    assert heading(client.get(f"/s/short{sign(aud=audience)}")) == HEADINGS["consent"]


def test_a_host_that_the_request_makes_up_is_not_ours(client: Api, sign: Sign) -> None:
    link = sign(aud="https://other.tool.example/s/short")
    page = client.get(f"/s/short{link}", headers={"Host": "other.tool.example"})
    assert page.status_code == 403


def test_the_consent_may_be_read_for_longer_than_the_token_lasts(
    client: Api, app: AppContext, sign: Sign
) -> None:
    client.get(f"/s/short{sign()}")
    found = client.get(f"/s/short/consent{sign()}").text
    version = found.split('name="version" value="')[1].split('"')[0]
    late = sign(exp=time.time() - 1200)
    sent_on(client.post(f"/s/short/consent{late}", data={"version": version}))
    assert sessions_and_people(app) == (1, 1)


def test_keys_are_kept_and_an_unknown_one_does_not_have_them_fetched_at_once(
    client: Api, sign: Sign, tmp_path: Path
) -> None:
    assert heading(client.get(f"/s/short{sign()}")) == HEADINGS["consent"]
    file = tmp_path / "jwks.json"
    other = file.read_text().replace('"k1"', '"k2"')
    file.write_text(other)
    assert client.get(f"/s/short{sign(kid='k2')}").status_code == 403
    assert heading(client.get(f"/s/short{sign()}")) == HEADINGS["consent"]
