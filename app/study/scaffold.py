"""Creates a study folder from a commented example: of one's own videos, or of a machine."""

import shutil
from pathlib import Path

EXAMPLE = Path(__file__).parent / "shipped" / "example"
#: Of a study whose videos a machine records; its texts are those of the other example.
MACHINE_EXAMPLE = Path(__file__).parent / "shipped" / "example-machine"


class FolderNotEmptyError(Exception):
    """The folder for a new study is not empty, or is a file."""


def require_empty(folder: Path) -> None:
    """Raises FolderNotEmptyError unless the folder is new or empty."""
    if folder.exists() and not folder.is_dir():
        raise FolderNotEmptyError(f"expected a new or empty folder, got the file {folder}")
    if folder.is_dir() and any(folder.iterdir()):
        raise FolderNotEmptyError(
            f"expected a new or empty folder, got {folder}, which holds something already"
        )


def init(folder: Path, *, machine: bool = False) -> None:
    """Writes the example study into a new or empty folder.

    machine: whether its videos are recorded by a machine while people choose.
    """
    require_empty(folder)
    # Contents only: an installed example may be read-only, and the copy is there to be edited.
    if not machine:
        shutil.copytree(EXAMPLE, folder, copy_function=shutil.copyfile, dirs_exist_ok=True)
        return
    shutil.copytree(MACHINE_EXAMPLE, folder, copy_function=shutil.copyfile, dirs_exist_ok=True)
    shutil.copytree(EXAMPLE / "texts", folder / "texts", copy_function=shutil.copyfile)
