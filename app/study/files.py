"""Files of a study folder: paths within it, and UTF-8 texts."""

from pathlib import Path, PurePosixPath

from .shortening import quoted
from .validation_errors import UnreadableFileError

#: The longest text, in bytes; a table of 20,000 videos takes a tenth of it.
LONGEST_TEXT = 20_000_000


def within(root: Path, path: Path) -> bool:
    """Whether the path is inside the folder after links and `..` are resolved.

    A study may come from another person: a link in it must not expose the server's own files in
    pages or exports.
    """
    try:
        return path.resolve().is_relative_to(root.resolve())
    except (OSError, RuntimeError):
        # Symbolic links in a cycle.
        return False


def is_file(path: Path) -> bool:
    """Whether the file exists; False for a name that the file system rejects."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def read_bytes(root: Path, path: Path) -> bytes:
    """The content of a file within `root`, of at most `LONGEST_TEXT` bytes.

    Raises UnreadableFileError.
    """
    if not is_file(path):
        raise UnreadableFileError("expected a file of this name, there is none")
    if not within(root, path):
        raise UnreadableFileError("expected a file inside the study folder, got a link out of it")
    try:
        with path.open("rb") as file:
            content = file.read(LONGEST_TEXT + 1)
    except OSError as error:
        raise UnreadableFileError(f"expected a file to read, got {error.strerror}") from error
    if len(content) > LONGEST_TEXT:
        raise UnreadableFileError(f"expected a text of at most {LONGEST_TEXT:,} bytes, got more")
    return content


def read_text(root: Path, path: Path) -> str:
    """The file's text with line ends as \\n and without a byte order mark.

    Raises UnreadableFileError, also for a text that is longer than `LONGEST_TEXT`.
    """
    content = read_bytes(root, path)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        byte = content[error.start]
        message = f"expected text in UTF-8, got the byte 0x{byte:02x}"
        raise UnreadableFileError(message, line) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def misplaced(name: str) -> str | None:
    """What is wrong with a path within a study folder, judged by its name; None if nothing is."""
    if not name:
        return "expected the name of a file, got nothing"
    path = PurePosixPath(name)
    if not path.parts:
        return f"expected the name of a file, got {quoted(name)}"
    if "\\" in name or "\0" in name or ":" in path.parts[0]:
        return f"expected a path with forward slashes such as videos/a.mp4, got {quoted(name)}"
    if path.is_absolute() or ".." in path.parts:
        return f"expected a path inside the study folder, got {quoted(name)}"
    return None
