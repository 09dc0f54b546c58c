"""Maps all stored data about evaluators to topics of the privacy page.

A test checks that every database column, every key of the browser's storage and every cookie has a
topic here, and that the page has a sentence for each topic.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from app.study.plan import Plan


class Topic(StrEnum):
    """Topics of the privacy page, one sentence each; the last is for data not about evaluators."""

    ANSWERS = "answers"
    PLAYBACK = "playback"
    DEVICE = "device"
    QUESTIONS = "questions"
    COURSE = "course"
    IDENTIFIERS = "identifiers"
    PERSONAL_LINK = "personal link"
    PSEUDONYM = "pseudonym"
    SECRETS = "secrets"
    SHARED_MODEL = "shared model"
    COUNT = "count"
    BROWSER = "browser"
    OTHER_SITES = "other sites"
    VIDEOS_ELSEWHERE = "videos elsewhere"
    BACKUPS = "backups"
    LOGS = "logs"
    NOT_EVALUATORS = "not about evaluators"


#: Topic of every column of the tables about evaluators. A new column must be added here.
EVALUATORS: Mapping[str, Mapping[Topic, str]] = {
    "participants": {
        Topic.PSEUDONYM: "id study_id pseudonym created_at",
    },
    "identities": {
        Topic.IDENTIFIERS: "id participant_id key value created_at",
    },
    "sessions": {
        Topic.COURSE: (
            "id study_id plan_id participant_id mode language seed order_index "
            "trial_conditions skip_reason_order stage trial_index query_index break_ends_at "
            "consent_version consented_at watched evaluator started_at last_seen_at ended_at "
            "expires_at"
        ),
        Topic.PSEUDONYM: "public_id",
        Topic.SECRETS: "token_hash receipt_hash",
        Topic.IDENTIFIERS: "platform",
    },
    "reentries": {
        Topic.SECRETS: "id session_id token_hash receipt_hash created_at",
    },
    "consents": {
        Topic.COURSE: "id session_id plan_id consent_version agreed_at",
    },
    "trials": {
        Topic.ANSWERS: (
            "id session_id trial_index condition method environment seed started_at ended_at"
        ),
    },
    "queries": {
        Topic.ANSWERS: (
            "id public_id trial_id query_index attempt trial_type left_candidate "
            "right_candidate left_recording_id right_recording_id acquisition seed "
            "engine_version created_at shown_at repeats_query_index set_aside_at "
            "fault left_rollout_id right_rollout_id proposed_from withdrawn_at"
        ),
    },
    "rollouts": {
        Topic.COURSE: "trial_id asked_at reason priority",
        Topic.NOT_EVALUATORS: (
            "id public_id study_id environment candidate_id run_index seed status attempt "
            "machine_id lease_until progress claimed_at ended_at explanation failures "
            "recording_id sha256 score series"
        ),
    },
    "responses": {
        Topic.ANSWERS: "id query_id response skip_reason rt_ms answered_at plan_id",
    },
    "undone_responses": {
        Topic.ANSWERS: "id query_id response skip_reason rt_ms answered_at undone_at",
    },
    "preferences": {
        Topic.ANSWERS: (
            "id trial_id preference_index winner loser origin query_index drawn_from_query_index"
        ),
    },
    "acquired": {
        Topic.ANSWERS: (
            "id trial_id query_index candidate posterior_mean posterior_std sureness computed_from"
        ),
    },
    "events": {
        Topic.PLAYBACK: "id session_id trial_index query_index event side time_ms value",
    },
    "questionnaire_answers": {
        Topic.QUESTIONS: "id session_id trial_index item value answered_at",
    },
    "entry_links": {
        Topic.PERSONAL_LINK: "id study_id token_hash label created_at used_at",
    },
    "tombstones": {
        Topic.COUNT: "id study_id mode stage reason deleted_at",
    },
    "deleted_sessions": {
        Topic.COUNT: "id deleted_study_id token_key",
    },
    "declined_counts": {
        Topic.COUNT: "id study_id day number",
    },
}
#: Tables without data about evaluators.
OTHERS = frozenset(
    {
        "deleted_studies",
        "studies",
        "plans",
        "candidates",
        "recordings",
        "machines",
        "study_access",
        "study_drafts",
        "accounts",
        "sign_ins",
        "api_tokens",
        "invitations",
        "failed_sign_ins",
        "audit_events",
        "jobs",
        "fault_counts",
        "server_secrets",
    }
)
#: Keys of the browser's storage by the script that writes them, and cookies by module.
BROWSER: Mapping[str, Topic] = {
    "localStorage outbox.js": Topic.BROWSER,
    "sessionStorage familiarisation.js": Topic.BROWSER,
    "sessionStorage eta.js": Topic.BROWSER,
    "sessionStorage typed_draft.js": Topic.BROWSER,
    "cookie session_cookies.py": Topic.BROWSER,
    "cookie leaving_pages.py": Topic.BROWSER,
    "cookie known_devices.py": Topic.NOT_EVALUATORS,
    "cookie sign_in_pages.py": Topic.NOT_EVALUATORS,
    "cookie security.py": Topic.NOT_EVALUATORS,
}


def topics(plan: Plan, *, videos_elsewhere: bool) -> tuple[Topic, ...]:
    """The topics of a study's privacy page, in order.

    videos_elsewhere: whether browsers load videos from another site.
    """
    asks = plan.questionnaires.after_trial or plan.questionnaires.end
    left_out = {
        Topic.NOT_EVALUATORS: True,
        Topic.DEVICE: plan.device_check is None,
        Topic.QUESTIONS: not asks,
        Topic.IDENTIFIERS: not plan.recruitment.link_parameters,
        Topic.SHARED_MODEL: not any(condition.is_shared for condition in plan.conditions),
        Topic.PERSONAL_LINK: plan.recruitment.links != "single-use",
        Topic.VIDEOS_ELSEWHERE: not videos_elsewhere,
        Topic.OTHER_SITES: videos_elsewhere,
    }
    return tuple(topic for topic in Topic if not left_out.get(topic, False))
