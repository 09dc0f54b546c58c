"""Who may do what, as a table: a rule for each page and each call of the application.

A new route needs a line in RULES: `"METHOD /path": <rule>`. The rules:

| rule | who gets in |
|---|---|
| DESIGN, DATA, CHANGE, OWN | by the right to the study (services/studies/access.py), for a page |
| DESIGN_FORM, CHANGE_FORM, OWN_FORM | the same for a form: programs have none of ours: refused |
| API_DATA | by the right to the data, for a call: 401 instead of the way to the sign-in |
| SIGNED_IN | everybody who is signed in, and their tokens |
| MAKE, MAKE_FORM | whoever may make studies |
| MY_DRAFT, MY_DRAFT_FORM | whoever makes this study in the browser, not even an admin |
| AT_THE_BROWSER | everybody who is signed in, and no token |
| MY_JOB | whoever asked for the work, and their tokens |
| ADMIN | admins, and no token |
| PREVIEW | by the right to change the study, and nobody else learns anything |
| ANYBODY | an account makes no difference |

`RULE.with_(params={...})` says what stands in the path, `query`, `form` and `json` what is sent.
Without them a path's own ids are made up, and being told that there is no such thing counts as
being let in: only those who get in may learn that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

#: Browsers, and programs with tokens of the study's owner. "other" has no tie to the study.
CALLERS = (
    *("admin", "owner", "shared", "other", "reviewer", "nobody"),
    *("read token", "write token"),
)

#: What a call may come to: let in, or kept out by one of these.
IN = "in"
SIGN_IN = "to the sign-in"
Verdict = int | str


@dataclass(frozen=True)
class Rule:
    """What each caller comes to; callers that are not named are let in."""

    name: str
    kept_out: Mapping[str, Verdict]
    params: Mapping[str, Any] = field(default_factory=dict)
    query: Mapping[str, str] = field(default_factory=dict)
    form: Mapping[str, str] = field(default_factory=dict)
    json: Any = None

    def expected(self, caller: str) -> Verdict:
        return self.kept_out.get(caller, IN)

    def with_(self, **changes: Any) -> Rule:
        return replace(self, **changes)

    def but(self, **kept_out: Verdict) -> Rule:
        """The same rule but for these callers."""
        return replace(self, kept_out={**self.kept_out, **_by_caller(kept_out)})


def _by_caller(kept_out: Mapping[str, Verdict]) -> dict[str, Verdict]:
    return {caller.replace("_", " "): said for caller, said in kept_out.items()}


def rule(name: str, **kept_out: Verdict) -> Rule:
    return Rule(name, _by_caller(kept_out))


_NOT_THERE: dict[str, Verdict] = {"nobody": SIGN_IN, "other": 404}
_NO_TOKENS: dict[str, Verdict] = {"read_token": 403, "write_token": 403}

DESIGN = rule("design", **_NOT_THERE)
DATA = rule("data", **_NOT_THERE, reviewer=403)
CHANGE = rule("change", **_NOT_THERE, reviewer=403, read_token=403)
OWN = rule("own", **_NOT_THERE, reviewer=403, read_token=403, shared=403)
DESIGN_FORM = rule("design, by form", **_NOT_THERE, **_NO_TOKENS)
CHANGE_FORM = rule("change, by form", **_NOT_THERE, **_NO_TOKENS, reviewer=403)
OWN_FORM = rule("own, by form", **_NOT_THERE, **_NO_TOKENS, reviewer=403, shared=403)
API_DATA = rule("data, by call", nobody=401, other=404, reviewer=403)
SIGNED_IN = rule("signed in", nobody=SIGN_IN)
MAKE = rule("make studies", nobody=SIGN_IN, reviewer=403, read_token=403)
MAKE_FORM = rule("make studies, by form", nobody=SIGN_IN, reviewer=403, **_NO_TOKENS)
MY_DRAFT = rule(
    "a draft of one's own",
    **{**_NOT_THERE, "admin": 404, "shared": 404, "reviewer": 404, "read_token": 404},
)
MY_DRAFT_FORM = rule(
    "a draft of one's own, by form",
    **{**_NOT_THERE, "admin": 404, "shared": 404, "reviewer": 404, **_NO_TOKENS},
)
MY_JOB = rule("a job of one's own", **_NOT_THERE, admin=404, shared=404, reviewer=404)
AT_THE_BROWSER = rule("at the browser", nobody=SIGN_IN, **_NO_TOKENS)
ADMIN = rule("admin", nobody=SIGN_IN, owner=403, shared=403, other=403, reviewer=403, **_NO_TOKENS)
ANYBODY = rule("anybody")
PREVIEW = Rule(
    "a preview, by the right to change the study",
    {**dict.fromkeys(("nobody", "other", "reviewer", "read token"), 403)},
)
#: In a pilot no account makes a difference; to begin one takes its link, which nobody here has.
PILOT = rule("a pilot")
NO_LINK = Rule("whoever has the link of the pilot", dict.fromkeys(CALLERS, 403))
_FIRST_PAGES = (("GET", ""), ("GET", "/consent"), ("POST", "/consent"))
NO_SESSION = Rule("whoever holds the session's token", dict.fromkeys(CALLERS, 401))

NO_MACHINE = Rule("whoever holds the token of a machine", dict.fromkeys(CALLERS, 401))

#: A job of the owner's.
JOB = "the-owners-job"
BOB = {"email": "bob@lab.example"}

RULES: Mapping[str, Rule] = {
    "GET /openapi.json": ANYBODY,
    "GET /": ANYBODY,
    # Machines; measurements are for whoever holds the token of the settings, and no account.
    "GET /healthz": ANYBODY,
    "GET /machine/pbpo_machine.py": ANYBODY,
    "GET /readyz": ANYBODY,
    "GET /metrics": ANYBODY,
    # Evaluators: their session's token, or nothing at all, says who they are.
    "POST /api/v1/studies/{slug}/sessions": ANYBODY,
    "POST /api/v1/studies/{slug}/deletions": ANYBODY,
    "GET /media/{public_id}.mp4": ANYBODY,
    "GET /styles/without-layers.css": ANYBODY,
    "GET /s/{slug}": ANYBODY,
    "GET /s/{slug}/consent": ANYBODY,
    "POST /s/{slug}/consent": ANYBODY,
    "POST /s/{slug}/decline": ANYBODY,
    "POST /s/{slug}/return": ANYBODY,
    "POST /s/{slug}/claim": ANYBODY,
    "GET /s/{slug}/not-you": ANYBODY,
    "POST /s/{slug}/begin-anew": ANYBODY,
    "POST /s/{slug}/continue": ANYBODY,
    "POST /s/{slug}/screen-out": ANYBODY,
    "POST /s/{slug}/questionnaire": ANYBODY,
    "POST /s/{slug}/respond": ANYBODY.with_(form={"query_id": "x", "response": "left"}),
    "GET /s/{slug}/withdraw": ANYBODY,
    "POST /s/{slug}/withdraw": ANYBODY,
    "GET /s/{slug}/delete": ANYBODY,
    "POST /s/{slug}/delete": ANYBODY,
    "GET /s/{slug}/deleted": ANYBODY,
    "GET /s/{slug}/privacy": ANYBODY,
    "GET /s/{slug}/trouble/{what}": ANYBODY.with_(params={"what": "videos"}),
    # The same pages in a preview, and in a pilot, for whose first page one needs its link.
    **{
        f"{method} {prefix}/s/{{slug}}{page}": rule.with_(form=form)
        for prefix, rule in (("/preview", PREVIEW), ("/pilot", PILOT))
        for method, page, form in (
            ("GET", "", {}),
            ("GET", "/consent", {}),
            ("POST", "/consent", {"version": "x"}),
            ("POST", "/decline", {}),
            ("POST", "/continue", {}),
            ("POST", "/screen-out", {}),
            ("POST", "/questionnaire", {}),
            ("POST", "/respond", {"query_id": "x", "response": "left"}),
            ("GET", "/withdraw", {}),
            ("POST", "/withdraw", {}),
            ("GET", "/delete", {}),
            ("POST", "/delete", {}),
            ("GET", "/deleted", {}),
            ("GET", "/privacy", {}),
        )
        if prefix == "/preview" or (method, page) not in _FIRST_PAGES
    },
    **{
        f"GET {prefix}/s/{{slug}}/trouble/{{what}}": rule.with_(params={"what": "videos"})
        for prefix, rule in (("/preview", PREVIEW), ("/pilot", PILOT))
    },
    **{
        f"{method} /pilot/s/{{slug}}{page}": NO_LINK.with_(form={"version": "x"})
        for method, page in _FIRST_PAGES
    },
    # Of a session: none of the callers here has one, and an account opens none.
    **{
        f"{method} /api/v1/session{step}": NO_SESSION.with_(json=body)
        for method, step, body in (
            ("GET", "", None),
            ("POST", "/consent", {"version": "x"}),
            ("POST", "/continue", None),
            ("POST", "/screen-out", None),
            ("POST", "/watched", {"index": 0}),
            ("POST", "/questionnaire", {"answers": {}}),
            ("POST", "/responses", {"query_id": "x", "response": "left"}),
            ("POST", "/undo", {"query_id": "x"}),
            ("POST", "/faults", {"query_id": "x"}),
            ("POST", "/withdraw", None),
        )
    },
    # Coming and going.
    "GET /sign-in": ANYBODY,
    "POST /sign-in": ANYBODY,
    "POST /sign-out": ANYBODY,
    "GET /invitations/{token}": ANYBODY,
    "POST /invitations/{token}": ANYBODY,
    # One's own account.
    "GET /account": AT_THE_BROWSER,
    "POST /account/password": AT_THE_BROWSER,
    "POST /account/sign-ins/end-others": AT_THE_BROWSER,
    "POST /account/sign-ins/{sign_in_id}/end": AT_THE_BROWSER.with_(params={"sign_in_id": 0}),
    "POST /account/tokens": AT_THE_BROWSER,
    "POST /account/tokens/{token_id}/revoke": AT_THE_BROWSER.with_(params={"token_id": 0}),
    # Everybody's accounts.
    "GET /accounts": ADMIN,
    "POST /accounts/invite": ADMIN.with_(form={"email": "new@lab.example", "role": "admin"}),
    "POST /accounts/reset": ADMIN.with_(form=BOB),
    "POST /accounts/role": ADMIN.with_(form={**BOB, "role": "reviewer"}),
    "POST /accounts/disable": ADMIN.with_(form=BOB),
    "POST /accounts/enable": ADMIN.with_(form=BOB),
    "POST /accounts/invitations/{invitation_id}/take-back": ADMIN.with_(
        params={"invitation_id": 0}
    ),
    "GET /activity": ADMIN,
    # Making studies.
    "GET /studies": SIGNED_IN,
    "GET /studies/new": MAKE,
    "POST /drafts": MAKE_FORM,
    "GET /drafts/{public_id}": MY_DRAFT,
    "POST /drafts/{public_id}/files": MY_DRAFT_FORM.but(read_token=404),
    "POST /drafts/{public_id}/remove": MY_DRAFT_FORM.with_(form={"file": "study.yaml"}),
    "GET /drafts/{public_id}/text": MY_DRAFT.with_(query={"file": "study.yaml"}),
    "POST /drafts/{public_id}/text": MY_DRAFT_FORM.with_(form={"file": "a.md", "text": "b"}),
    "GET /drafts/{public_id}/settings": MY_DRAFT,
    "POST /drafts/{public_id}/settings": MY_DRAFT_FORM.with_(form={"queries": "3"}),
    "POST /drafts/{public_id}/mend": MY_DRAFT_FORM,
    "POST /drafts/{public_id}/parameters": MY_DRAFT_FORM,
    "POST /drafts/{public_id}/transcode": MY_DRAFT_FORM,
    "POST /drafts/{public_id}/create": MY_DRAFT_FORM,
    "POST /drafts/{public_id}/discard": MY_DRAFT_FORM,
    "GET /jobs/{public_id}": MY_JOB.with_(params={"public_id": JOB}),
    # One study: its design.
    "GET /studies/{slug}": DESIGN,
    "GET /studies/{slug}/plan": DESIGN,
    "GET /studies/{slug}/plan/study.yaml": DESIGN,
    "GET /studies/{slug}/ethics": DESIGN,
    "GET /studies/{slug}/ethics.zip": DESIGN,
    "POST /studies/{slug}/ethics/bundle": DESIGN_FORM,
    # Its data.
    "GET /studies/{slug}/live": DATA,
    "GET /studies/{slug}/events": DATA,
    "GET /studies/{slug}/results": DATA,
    "GET /studies/{slug}/results/answer": DATA,
    "GET /studies/{slug}/results/people": DATA,
    "GET /studies/{slug}/results/people/{name}.{form}": DATA.with_(params={"name": "noise"}),
    "GET /studies/{slug}/figures/{name}.{form}": DATA,
    "GET /studies/{slug}/sessions/{session_id}": DATA,
    "GET /studies/{slug}/sessions/{session_id}/figures/{trial_index}/{name}.{form}": DATA,
    "GET /studies/{slug}/activity": DATA,
    "GET /studies/{slug}/data": DATA,
    "GET /studies/{slug}/data/download": DATA.with_(query={"format": "botorch"}),
    "GET /studies/{slug}/data/report.{form}": DATA.with_(params={"form": "html"}),
    "GET /studies/{slug}/people": DATA,
    "GET /api/v1/studies/{slug}/export.zip": API_DATA,
    "GET /api/v1/studies/{slug}/report.{form}": API_DATA.with_(params={"form": "html"}),
    "GET /api/v1/studies/{slug}/export/{table}.csv": API_DATA.with_(params={"table": "sessions"}),
    "GET /api/v1/studies/{slug}/rollouts": API_DATA,
    # Of a machine: an account opens none of them (test_rollout_calls has what its token opens).
    **{
        f"{method} /api/v1/studies/{{slug}}/rollouts/{step}": NO_MACHINE.with_(json=body)
        for method, step, body in (
            ("POST", "claim", {}),
            ("POST", "{rollout_id}/heartbeat", {}),
            ("PUT", "{rollout_id}/recording", None),
            ("POST", "{rollout_id}/measurements", {}),
            ("POST", "{rollout_id}/failed", {"reason": "x"}),
            ("POST", "{rollout_id}/unsafe", {"reason": "x"}),
        )
    },
    # What changes it.
    "GET /studies/{slug}/manage": CHANGE,
    "GET /studies/{slug}/open": CHANGE,
    "GET /studies/{slug}/texts": CHANGE,
    "GET /studies/{slug}/recruit": CHANGE,
    "GET /studies/{slug}/machines": CHANGE,
    "POST /studies/{slug}/machines": CHANGE_FORM.with_(form={"name": "arm"}),
    "POST /studies/{slug}/machines/revoke": CHANGE_FORM.with_(form={"name": "arm"}),
    "POST /studies/{slug}/machines/stop": CHANGE_FORM,
    "POST /studies/{slug}/machines/release": CHANGE_FORM,
    "POST /studies/{slug}/machines/results": CHANGE_FORM,
    "POST /studies/{slug}/machines/withdraw": CHANGE_FORM.with_(
        form={"name": "arm", "since": "2026-01-01T00:00", "reason": "wrong"}
    ),
    "POST /studies/{slug}/rollouts/{rollout_id}/cancel": CHANGE_FORM,
    "POST /studies/{slug}/rollouts/{rollout_id}/retry": CHANGE_FORM,
    "POST /studies/{slug}/rollouts/{rollout_id}/withdraw": CHANGE_FORM,
    "GET /studies/{slug}/desk": CHANGE,
    "POST /studies/{slug}/desk/take": CHANGE_FORM,
    "POST /studies/{slug}/desk/{rollout_id}/recording": CHANGE_FORM,
    "POST /studies/{slug}/desk/{rollout_id}/report": CHANGE_FORM.with_(form={"what": "back"}),
    "POST /studies/{slug}/preview": CHANGE_FORM,
    "POST /studies/{slug}/open": CHANGE_FORM,
    "POST /studies/{slug}/close": CHANGE_FORM,
    "POST /studies/{slug}/pause": CHANGE_FORM,
    "POST /studies/{slug}/resume": CHANGE_FORM,
    "POST /studies/{slug}/clone": CHANGE_FORM,
    "POST /studies/{slug}/texts": CHANGE_FORM,
    "POST /studies/{slug}/links": CHANGE_FORM,
    "POST /studies/{slug}/conditions": CHANGE_FORM,
    "POST /studies/{slug}/pilot/link": CHANGE_FORM,
    "POST /studies/{slug}/pilot/end": CHANGE_FORM,
    "POST /studies/{slug}/simulate": CHANGE_FORM,
    "POST /studies/{slug}/power": CHANGE_FORM,
    "GET /studies/{slug}/people/delete": CHANGE.with_(query={"participant": "P-1"}),
    "POST /studies/{slug}/people/delete": CHANGE_FORM.with_(form={"participant": "P-1"}),
    "POST /studies/{slug}/people/find": CHANGE_FORM.with_(form={"who": "P-1"}),
    "GET /studies/{slug}/people/data.zip": CHANGE.with_(query={"participant": "P-1"}),
    "POST /studies/{slug}/people/delete-by-receipt": CHANGE_FORM.with_(form={"receipt": "x"}),
    # What only its owner does.
    "POST /studies/{slug}/people/share": OWN_FORM.with_(form=BOB),
    "POST /studies/{slug}/people/unshare": OWN_FORM.with_(form={"account_id": "0"}),
    "POST /studies/{slug}/delete": OWN_FORM,
}
