"""The models as a process finds them that imports only some."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from app.storage import models

SUBJECTS = sorted(
    file.stem for file in Path(models.__file__).parent.glob("*.py") if file.stem != "__init__"
)


@pytest.mark.parametrize("subject", ["accounts", "studies"])
def test_a_process_that_imports_one_subject_knows_the_tables_of_all(subject: str) -> None:
    program = (
        f"import sys, app.storage.models.{subject};"
        "from app.storage.models.studies import Base;"
        "Base.metadata.sorted_tables;"  # resolves every foreign key, or raises
        "prefix = 'app.storage.models.';"
        "print(*sorted(n.removeprefix(prefix) for n in sys.modules if n.startswith(prefix)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.stdout.split() == SUBJECTS, done.stderr
