"""The sentences of the privacy page: one for each topic of stored data."""

from __future__ import annotations

from collections.abc import Mapping
from urllib.parse import urlsplit

from app.services.context import AppContext
from app.services.ethics.personal_data import Topic, topics
from app.study.plan import Plan
from app.web.http.translations import Wording, translatable, translated

SENTENCES: Mapping[Topic, str] = {
    Topic.ANSWERS: translatable(
        "Each answer: which video you chose or that you skipped, and how long it took you."
    ),
    Topic.PLAYBACK: translatable(
        "How the two videos were shown to you: whether they played smoothly and to their ends, how"
        " large they were and how they stood, whether you turned the device or changed the window,"
        " how often you played them again, whether the page was in front, and whether you answered"
        " by mouse, touch, pen or keyboard."
    ),
    Topic.DEVICE: translatable(
        "From the device check: how wide the page is, and how fast the connection."
    ),
    Topic.QUESTIONS: translatable(
        "Your answers to the questionnaires. Please write nothing there that says who you are."
    ),
    Topic.COURSE: translatable(
        "When you agreed to take part, to which text and in which language, and when you came and"
        " left."
    ),
    Topic.IDENTIFIERS: translatable(
        "The identifiers that %(platform)s puts into your link. They are kept apart from your"
        " answers."
    ),
    Topic.PERSONAL_LINK: translatable(
        "That your personal link was used, and on which day, so that it lets in one person only."
    ),
    Topic.SECRETS: translatable(
        "Of the secret in your browser's cookie, and of your receipt code, a fingerprint from which"
        " neither can be read."
    ),
    Topic.PSEUDONYM: translatable(
        "Your name, your email address, your IP address and the make of your device are not kept."
        " In the data you have a random name, such as P-7KQ2-MXRD."
    ),
    Topic.SHARED_MODEL: translatable(
        "The answers of all people have a part in which pairs each is shown. No answer is shown to"
        " anybody else who takes part. If you leave the study or have your answers deleted, yours"
        " have no such part from then on. Pairs that others were shown before stay as they were."
    ),
    Topic.COUNT: translatable(
        "Deleted answers cannot be brought back. That somebody once was here is kept, as a number"
        " alone. What was published or downloaded before is no longer in our hands."
    ),
    Topic.BROWSER: translatable(
        "Your browser keeps cookies, by which the study finds your place again and knows which link"
        " you came by, an answer that could not be sent yet, what you have typed into a"
        " questionnaire until it is sent, and, until you close the tab, your pace and the speed at"
        " which you watch."
    ),
    Topic.OTHER_SITES: translatable("Nothing comes from or goes to other sites."),
    Topic.VIDEOS_ELSEWHERE: translatable(
        "The videos come from %(site)s, which learns your IP address and when you watch. Nothing"
        " else comes from or goes to other sites."
    ),
    Topic.BACKUPS: translatable(
        "Backups that were made before a deletion still hold what was deleted, until they are"
        " thrown away."
    ),
    Topic.LOGS: translatable(
        "The program's logs hold no name, no identifier and no IP address of yours."
    ),
}

#: Where on the page each stands; what is in neither of the two follows the deletion.
_LISTED = (
    *(Topic.ANSWERS, Topic.PLAYBACK, Topic.DEVICE, Topic.QUESTIONS, Topic.COURSE),
    *(Topic.IDENTIFIERS, Topic.PERSONAL_LINK, Topic.SECRETS),
)
_BELOW = (*(Topic.PSEUDONYM, Topic.LOGS, Topic.BROWSER, Topic.OTHER_SITES, Topic.VIDEOS_ELSEWHERE),)


def sentences(app: AppContext, plan: Plan, wording: Wording) -> dict[str, list[str]]:
    """The sentences for this study, by their section of the page."""
    origin = app.recordings.origin
    values = {"platform": plan.recruitment.label, "site": urlsplit(origin or "").netloc}
    said = topics(plan, videos_elsewhere=origin is not None)

    def of(chosen: tuple[Topic, ...]) -> list[str]:
        return [translated(SENTENCES[topic], wording) % values for topic in chosen]

    return {
        "listed": of(tuple(topic for topic in said if topic in _LISTED)),
        "below": of(tuple(topic for topic in _BELOW if topic in said)),
        "deletion": of(tuple(t for t in said if t not in (*_LISTED, *_BELOW))),
    }
