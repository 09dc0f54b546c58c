"""The purpose of every stored column. A test fails if a column has none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum


class DataSubject(StrEnum):
    """The subject of the data in a table."""

    ANSWERS = "a participant, under a pseudonym"
    IDENTITIES = "a participant, as a platform calls them"
    COUNT = "nobody: a count"
    STUDY = "the study itself"
    STAFF = "those who run studies"
    SERVER = "nobody: the server's own"


@dataclass(frozen=True)
class StoredTable:
    """One table: its subject, and the purpose of each column."""

    subject: DataSubject
    purposes: Mapping[str, str]


_ID = "Joins this row to others."
_MADE = "When this was made, for the record."

STORED: Mapping[str, StoredTable] = {
    "participants": StoredTable(
        DataSubject.ANSWERS,
        {
            "id": _ID,
            "study_id": _ID,
            "pseudonym": "A random name: keeps a person's answers together without naming them.",
            "created_at": "When the person first came: the flow of participants over time.",
        },
    ),
    "identities": StoredTable(
        DataSubject.IDENTITIES,
        {
            "id": _ID,
            "participant_id": _ID,
            "key": "What the recruitment platform calls the kind of id.",
            "value": "The platform's id: to recognise who comes back, to lead back, and to pay.",
            "created_at": "When it was given: its deletion is counted from the session's end.",
        },
    ),
    "sessions": StoredTable(
        DataSubject.ANSWERS,
        {
            "id": _ID,
            "public_id": "A random name of the session, for exports.",
            "study_id": _ID,
            "plan_id": "Under which version of the plan and texts the session began.",
            "participant_id": _ID,
            "token_hash": "Lets the person's own browser, and no other, go on with the session.",
            "mode": "Tells what counts from previews, pilots and simulations, which never do.",
            "language": "Which texts were read.",
            "seed": "Makes everything random in the session repeatable.",
            "order_index": "Which order of conditions was given: counterbalancing.",
            "trial_conditions": "What was compared in which order.",
            "skip_reason_order": "In which drawn order the reasons of a skip were listed.",
            "stage": "Where the session stands, so that it can go on there.",
            "trial_index": "Where the session stands, so that it can go on there.",
            "query_index": "Where the session stands, so that it can go on there.",
            "break_ends_at": "When a break is over.",
            "consent_version": "Which text the person last agreed to.",
            "consented_at": "When the person last agreed.",
            "platform": "Which recruitment platform the person came from.",
            "receipt_hash": "Lets the person have everything deleted later, without a name.",
            "watched": "Which introductory videos were watched to the end.",
            "evaluator": "What program answered a simulated session; empty for people.",
            "started_at": "Duration of taking part.",
            "last_seen_at": "Tells who is still there from who left: free places, expiry.",
            "ended_at": "Duration of taking part; retention counts from it.",
            "expires_at": "When an unfinished session can no longer be taken up.",
        },
    ),
    "consents": StoredTable(
        DataSubject.ANSWERS,
        {
            "id": _ID,
            "session_id": _ID,
            "plan_id": "Under which version of the plan and texts.",
            "consent_version": "Which text the person agreed to: proof of each consent.",
            "agreed_at": "When the person agreed.",
        },
    ),
    "declined_counts": StoredTable(
        DataSubject.COUNT,
        {
            "id": _ID,
            "study_id": _ID,
            "day": "On which day; not at which moment, which could be matched.",
            "number": "How often somebody declined: the flow of participants.",
        },
    ),
    "reentries": StoredTable(
        DataSubject.ANSWERS,
        {
            "id": _ID,
            "session_id": _ID,
            "token_hash": "Lets somebody who came back in another browser go on.",
            "receipt_hash": "Lets the person have everything deleted later, without a name.",
            "created_at": _MADE,
        },
    ),
    "trials": StoredTable(
        DataSubject.ANSWERS,
        {
            "id": _ID,
            "session_id": _ID,
            "trial_index": "Which part of the session it is.",
            "condition": "What was compared by which method.",
            "method": "What was compared by which method.",
            "environment": "Which set of videos was shown.",
            "seed": "Makes the choice of videos repeatable.",
            "started_at": "Duration of each part.",
            "ended_at": "Duration of each part.",
        },
    ),
    "queries": StoredTable(
        DataSubject.ANSWERS,
        {
            "id": _ID,
            "public_id": "A random name of the pair, for the browser that shows it.",
            "trial_id": _ID,
            "query_index": "Which pair of its part it is.",
            "attempt": "How often the pair was replaced after a technical fault.",
            "trial_type": "Tells pairs that teach the method from checks of attention.",
            "left_candidate": "What was shown on the left.",
            "right_candidate": "What was shown on the right.",
            "left_recording_id": "Which video was shown on the left.",
            "right_recording_id": "Which video was shown on the right.",
            "acquisition": "How the method chose the pair.",
            "seed": "Makes the choice of the pair repeatable.",
            "engine_version": "Which version of the method chose the pair.",
            "created_at": _MADE,
            "shown_at": "When the pair was first on the screen.",
            "repeats_query_index": "Which earlier pair is shown again: agreement with oneself.",
            "set_aside_at": "When the pair was set aside for a technical fault.",
            "fault": "Which technical fault: videos that did not play.",
            "left_rollout_id": "Which run of a machine the video on the left is of.",
            "right_rollout_id": "Which run of a machine the video on the right is of.",
            "proposed_from": "From which answers the method chose the pair.",
            "withdrawn_at": "When the answer left the model: its video was withdrawn.",
        },
    ),
    "responses": StoredTable(
        DataSubject.ANSWERS,
        {
            "id": _ID,
            "query_id": _ID,
            "response": "What the person preferred, or that they skipped: the study's question.",
            "skip_reason": "Why they skipped, where the study asks.",
            "rt_ms": "How long it took: effort, and answers too fast to be meant.",
            "answered_at": "The order and pace of answers.",
            "plan_id": "Under which version of plan and consent it was given.",
        },
    ),
    "undone_responses": StoredTable(
        DataSubject.ANSWERS,
        {
            "id": _ID,
            "query_id": _ID,
            "response": "What was pressed and taken back: how often people err.",
            "skip_reason": "Why they skipped, where the study asks.",
            "rt_ms": "How long it took.",
            "answered_at": "When it was pressed.",
            "undone_at": "When it was taken back.",
        },
    ),
    "preferences": StoredTable(
        DataSubject.ANSWERS,
        {
            "id": _ID,
            "trial_id": _ID,
            "preference_index": "The order in which the method learned.",
            "winner": "What the method learned from an answer.",
            "loser": "What the method learned from an answer.",
            "origin": "Tells what was answered from what was worked out from a skip.",
            "query_index": "From which answer it was learned.",
            "drawn_from_query_index": "From which earlier answer it was worked out.",
        },
    ),
    "acquired": StoredTable(
        DataSubject.ANSWERS,
        {
            "id": _ID,
            "trial_id": _ID,
            "query_index": "After which answer.",
            "candidate": "What the method then held to be liked best: the study's outcome.",
            "posterior_mean": "How much it held it to be liked.",
            "posterior_std": "How uncertain that was.",
            "sureness": "How sure it was that nothing is liked much better.",
            "computed_from": "From which answers it was computed.",
        },
    ),
    "events": StoredTable(
        DataSubject.ANSWERS,
        {
            "id": _ID,
            "session_id": _ID,
            "trial_index": "During which pair it happened.",
            "query_index": "During which pair it happened.",
            "event": "How videos were shown (played, stalled, replayed; page in front or not):"
            " whether an answer rests on having seen them.",
            "side": "Which of the two videos.",
            "time_ms": "When, counted from the pair's first appearance.",
            "value": "A measure that goes with it, such as a width or a number of replays.",
        },
    ),
    "questionnaire_answers": StoredTable(
        DataSubject.ANSWERS,
        {
            "id": _ID,
            "session_id": _ID,
            "trial_index": "After which part it was asked.",
            "item": "Which question.",
            "value": "The answer; the plan shows every question.",
            "answered_at": "When it was answered.",
        },
    ),
    "tombstones": StoredTable(
        DataSubject.COUNT,
        {
            "id": _ID,
            "study_id": _ID,
            "mode": "Tells people from previews and pilots.",
            "stage": "How far the deleted session had come: the flow of participants.",
            "reason": "Whether it was deleted at the person's wish or by the retention rule.",
            "deleted_at": "On which day; not at which moment, which could be matched.",
        },
    ),
    "fault_counts": StoredTable(
        DataSubject.COUNT,
        {
            "id": _ID,
            "study_id": _ID,
            "kind": "What failed, such as a page or a video.",
            "hour": "In which hour.",
            "number": "How often: whether those who run the study have to do something.",
            "last_at": "When last, to find it in the server's log.",
        },
    ),
    "studies": StoredTable(
        DataSubject.STUDY,
        {
            "id": _ID,
            "slug": "The study's name in its address.",
            "status": "Whether people are let in.",
            "created_at": _MADE,
            "opened_at": "When people were first let in.",
            "closed_at": "Since when nobody is let in.",
            "paused_at": "Since when nobody is let in for a while.",
            "pilot_link_hash": "Lets people into a pilot, which does not count.",
            "conditions_off": "Conditions that new sessions are not given any more.",
            "machines_stopped_at": "Since when machines are given no work: the emergency stop.",
        },
    ),
    "plans": StoredTable(
        DataSubject.STUDY,
        {
            "id": _ID,
            "study_id": _ID,
            "version": "Number of the version.",
            "plan_hash": "Shows that a plan was not changed afterwards.",
            "plan": "What the study does.",
            "texts": "What people read.",
            "created_at": _MADE,
        },
    ),
    "candidates": StoredTable(
        DataSubject.STUDY,
        {
            "id": _ID,
            "study_id": _ID,
            "environment": "Which set of videos it belongs to.",
            "candidate_index": "Its number in results.",
            "parameters": "What is compared.",
            "point_key": "Tells the points of a range apart.",
        },
    ),
    "machines": StoredTable(
        DataSubject.STUDY,
        {
            "id": _ID,
            "study_id": _ID,
            "name": "What the experimenters call the machine that records videos.",
            "token_hash": "Lets this machine, and no other, make recordings of the study.",
            "created_at": _MADE,
            "revoked_at": "Since when the machine is not let in any more.",
            "last_seen_at": "Whether the machine is there.",
        },
    ),
    "rollouts": StoredTable(
        DataSubject.STUDY,
        {
            "id": _ID,
            "public_id": "A random name of the run, for the machine that makes it.",
            "study_id": _ID,
            "environment": "Where the machine runs.",
            "candidate_id": "What the machine runs.",
            "run_index": "Tells runs of the same candidate apart.",
            "seed": "Makes a simulated run repeatable.",
            "reason": "Whether somebody waits for it.",
            "priority": "Which run is made first.",
            "trial_id": "For which part of which session it was first asked.",
            "status": "Whether it was recorded, failed or was unsafe.",
            "attempt": "How often a machine tried.",
            "machine_id": "Which machine made it.",
            "lease_until": "When another machine may take it over.",
            "progress": "How far the machine is.",
            "asked_at": "How long people wait.",
            "claimed_at": "How long a run takes.",
            "ended_at": "How long a run takes.",
            "explanation": "Why it failed, was unsafe or was withdrawn.",
            "failures": "Which machine failed when, and why.",
            "recording_id": "Which recording it became.",
            "sha256": "Tells whether a recording is the one that the machine sent.",
            "score": "A number of the machine's own, for analyses.",
            "series": "Numbers of the machine's own, for analyses.",
        },
    ),
    "recordings": StoredTable(
        DataSubject.STUDY,
        {
            "id": _ID,
            "candidate_id": _ID,
            "run_index": "Its number among the recordings of the same candidate.",
            "public_id": "A random name, so that an address gives nothing away.",
            "source": "Where the video comes from.",
            "locator": "Where the video is.",
            "file": "What the experimenter's file was called.",
            "duration_s": "How long the video is.",
            "score": "A measure of the recording, for comparison with what people prefer.",
        },
    ),
    "entry_links": StoredTable(
        DataSubject.STUDY,
        {
            "id": _ID,
            "study_id": _ID,
            "token_hash": "Lets one person in, once; it is not known who used it.",
            "label": "The experimenter's note on what the links are for.",
            "created_at": _MADE,
            "used_at": "On which day it was used.",
        },
    ),
    "accounts": StoredTable(
        DataSubject.STAFF,
        {
            "id": _ID,
            "email": "Who signs in.",
            "password_hash": "Checks a password without keeping it (Argon2id).",
            "role": "What the account may do.",
            "created_at": _MADE,
            "disabled_at": "Since when nobody can sign in with it.",
        },
    ),
    "sign_ins": StoredTable(
        DataSubject.STAFF,
        {
            "id": _ID,
            "account_id": _ID,
            "token_hash": "Keeps a browser signed in.",
            "created_at": "Lets its owner see where they are signed in.",
            "expires_at": "When it ends by itself.",
        },
    ),
    "api_tokens": StoredTable(
        DataSubject.STAFF,
        {
            "id": _ID,
            "account_id": _ID,
            "label": "Its owner's note on what it is for.",
            "token_hash": "Lets a program in.",
            "scope": "Whether it may change anything.",
            "created_at": _MADE,
            "expires_at": "When it ends by itself.",
        },
    ),
    "invitations": StoredTable(
        DataSubject.STAFF,
        {
            "id": _ID,
            "token_hash": "Lets somebody choose a password, once.",
            "email": "For whom.",
            "role": "What the new account may do.",
            "created_at": _MADE,
            "expires_at": "When it ends by itself.",
            "used_at": "That it was used.",
        },
    ),
    "failed_sign_ins": StoredTable(
        DataSubject.STAFF,
        {
            "id": _ID,
            "key_hash": "Counts tries for an address, to slow down who guesses passwords.",
            "failed_at": "Forgotten after 15 minutes.",
        },
    ),
    "study_access": StoredTable(
        DataSubject.STAFF,
        {
            "id": _ID,
            "study_id": _ID,
            "account_id": _ID,
            "access": "Whose the study is, and whom it is shared with.",
            "created_at": _MADE,
        },
    ),
    "deleted_studies": StoredTable(
        DataSubject.COUNT,
        {
            "id": _ID,
            "slug": "What the deleted study's address was, so that it can be told from a mistake.",
            "way_back": "The platform's code for those whom the deletion stopped.",
            "deleted_on": "The day of the deletion.",
        },
    ),
    "deleted_sessions": StoredTable(
        DataSubject.COUNT,
        {
            "id": _ID,
            "deleted_study_id": _ID,
            "token_key": "Lets a browser that was in a deleted study have that code: a hash of"
            " random letters, removed after 30 days.",
        },
    ),
    "audit_events": StoredTable(
        DataSubject.STAFF,
        {
            "id": _ID,
            "happened_at": "When it was done.",
            "actor": "Who did it: an account, the command line, or the retention rule.",
            "action": "What was done; it is never changed or deleted.",
            "study_slug": "With which study.",
            "details": "With what: numbers and accounts, never a participant's answers.",
        },
    ),
    "jobs": StoredTable(
        DataSubject.STAFF,
        {
            "id": _ID,
            "public_id": "A random name for the page that watches the work.",
            "account_id": "Who asked for it.",
            "study_id": _ID,
            "kind": "What work it is: a simulation, a transcoding, a report.",
            "state": "How far it is.",
            "done": "How far it is.",
            "total": "How far it is.",
            "request": "What was asked for.",
            "message": "What came of it.",
            "created_at": _MADE,
            "started_at": "When it began.",
            "seen_at": "Whether it is still being done.",
            "ended_at": "When it was done.",
        },
    ),
    "study_drafts": StoredTable(
        DataSubject.STAFF,
        {
            "id": _ID,
            "public_id": "A random name for its address.",
            "account_id": "Who makes it.",
            "name": "What it is called.",
            "created_at": _MADE,
            "changed_at": "When it was last worked on.",
        },
    ),
    "server_secrets": StoredTable(
        DataSubject.SERVER,
        {
            "id": "There is one row.",
            "secret": "Random bytes: the server derives from them the keys that it signs with.",
            "created_at": _MADE,
        },
    ),
}
