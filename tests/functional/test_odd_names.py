"""Names that no file system takes, or that another file has: refused, never a fault of ours."""

from __future__ import annotations

import contextlib
import io

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.drafts import drafts
from app.services.drafts.files import Sent
from app.services.drafts.uploads import UploadRefusedError
from tests.unit.study.test_odd_yaml import ODD

from .client import Api
from .desk import Desk
from .test_hostile_uploads import packed


@pytest.fixture
def desk(client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "mo@lab.example", Role.EXPERIMENTER)


NAMES = [
    "日" * 180 + ".txt",
    "x" * 250 + ".txt",
    "texts",
    "texts/en",
    "texts/en/consent.md/x.md",
    "study.yaml/x.txt",
    "STUDY.yaml",
    "Texts/en/consent.md",
    "a\0.txt",
    "con",
    "texts/en/NUL.md",
    "com1.txt",
    "a/" * 90 + "a.txt",
    "ends with a stop.",
    "folder./x.txt",
    " x.txt",
    "x.txt ",
    "/x.txt",
    "C:/x.txt",
    "a\\b.txt",
    "a//b.txt",
    "./a.txt",
    "..",
    ".",
    "~",
    "\u202ea.txt",
    "e\u0301" * 90 + ".txt",
]


@pytest.mark.parametrize("name", NAMES[:20])
@pytest.mark.parametrize("as_zip", [False, True])
def test_an_odd_name_is_taken_or_refused_in_words(desk: Desk, name: str, as_zip: bool) -> None:
    here = desk.begin({}, name="Odd")
    before = desk.get(f"{here}/text?file=study.yaml").text
    sent = {"odd.zip": packed((name, b"x"), ("also.txt", b"x"))} if as_zip else {name: b"x"}
    answer = desk.send(f"{here}/files", sent)
    assert answer.status_code in (303, 400, 422)
    if answer.status_code == 422:
        assert "Expected" in answer.text
    # The draft is there, with its plan as it was.
    assert "fault" in desk.get(here).text
    assert desk.get(f"{here}/text?file=study.yaml").text == before
    for path in (f"{here}/text", f"{here}/remove"):
        assert desk.post(path, file=name, text="x").status_code < 500
    assert desk.client.get(f"{here}/text", params={"file": name}).status_code < 500
    assert desk.get(here).status_code == 200


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("日" * 180 + ".txt", "240 bytes"),
        ("texts", "is a folder"),
        ("study.yaml/x.txt", "is a file"),
        ("STUDY.yaml", "each file once"),
        ("com1.txt", "Windows"),
        ("a/" * 20 + "b", "folders deep"),
    ],
)
def test_a_refused_name_is_told_why(desk: Desk, name: str, sentence: str) -> None:
    here = desk.begin({}, name="Odd")
    answer = desk.send(f"{here}/files", {name: b"x"})
    assert (answer.status_code, sentence in answer.text) == (422, True)


def test_two_files_of_one_name_are_not_one(desk: Desk, app: AppContext) -> None:
    here = desk.begin({}, name="Odd")
    draft = drafts.find(app, desk.account, here.rpartition("/")[2])
    for first, second in (("a.txt", "A.txt"), ("a.txt", "a.txt"), ("a", "a/b.txt")):
        sent = [Sent(first, packed_file(b"1")), Sent(second, packed_file(b"2"))]
        with pytest.raises(UploadRefusedError, match="Expected"):
            drafts.add(app, desk.account, draft, sent)
    assert "a.txt" not in desk.get(here).text


def packed_file(content: bytes) -> io.BytesIO:
    return io.BytesIO(content)


@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(
    names=st.lists(
        st.one_of(
            st.sampled_from(NAMES),
            st.text(max_size=12),
            st.text(alphabet="aA./日 \\:", min_size=1, max_size=8),
            st.just("z.zip"),
        ),
        max_size=4,
    ),
    content=st.binary(max_size=30),
)
def test_no_names_are_a_fault_of_ours(
    desk: Desk, app: AppContext, names: list[str], content: bytes
) -> None:
    draft = drafts.begin(app, desk.account, "Odd")
    for sent in ([Sent(name, io.BytesIO(content)) for name in names], [_zip_of(names, content)]):
        with contextlib.suppress(UploadRefusedError):
            drafts.add(app, desk.account, draft, sent)
        drafts.files(draft)
        assert drafts.text_of(draft, "study.yaml")
    drafts.discard(app, draft)


@pytest.mark.filterwarnings("ignore:Duplicate name:UserWarning")
def _zip_of(names: list[str], content: bytes) -> Sent:
    entries = {name: content for name in names if name.strip("\0")}
    return Sent("all.zip", io.BytesIO(packed(*entries.items())))


@pytest.mark.parametrize("value", ODD[::5], ids=lambda value: value[:20])
def test_a_draft_stays_within_reach_whatever_its_plan_says(desk: Desk, value: str) -> None:
    here = desk.begin({}, name="Odd")
    saved = desk.post(f"{here}/text", file="study.yaml", text=f"version: {value}\ntitle: x\n")
    assert saved.status_code in (303, 422)
    for path in (here, f"{here}/text?file=study.yaml", "/studies"):
        assert desk.get(path).status_code == 200
    assert desk.get(f"{here}/settings").status_code in (200, 422)
    assert desk.post(f"{here}/settings", languages="en, ja").status_code in (303, 422)
    assert desk.post(f"{here}/create").status_code == 422
    assert desk.post(f"{here}/text", file="study.yaml", text="version: 1\n").status_code == 303


@pytest.mark.parametrize(
    "table",
    [
        "file\n.\n",
        "file\n" + "日" * 300 + ".mp4\n",
        "file\nstudy.yaml/a.mp4\n",
        "file\n\0\n",
        "file\n" + "x" * 200_000 + "\n",
        "file,file\na,b,c,d\n",
        '"file\n',
        "\ufefffile\n\u2028\n",
        "w,file\n" + "9" * 9_000 + ",a.mp4\n",
    ],
    ids=str.__len__,
)
def test_a_draft_stays_within_reach_whatever_its_table_says(desk: Desk, table: str) -> None:
    answer = desk.send("/drafts", {"recordings.csv": table.encode()}, name="Odd")
    assert answer.status_code in (303, 422)
    if answer.status_code == 303:
        here = answer.headers["location"]
        assert desk.get(here).status_code == 200
        assert len(desk.get(here).text) < 100_000
        assert desk.send(f"{here}/files", {"recordings.csv": b"file\n"}).status_code == 303
