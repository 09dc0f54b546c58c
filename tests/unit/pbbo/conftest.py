"""What the tests of this room share."""

from collections.abc import Iterator

import pytest

from app.pbbo.one_thread import one_thread


@pytest.fixture(autouse=True, scope="session")
def on_one_thread() -> Iterator[None]:
    """Tests reach past the door, behind which a step keeps to one core."""
    with one_thread():
        yield
