"""Files that a run writes: whole or not at all. What stood there before is replaced when the new one is on the disk."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from vlmb.errors import OutputError, VlmbError

FULL = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give an empty file beside a path to write to; once it is whole and on the disk it takes the place of the path.

    Anything raised meanwhile leaves what stood there before. Devices and pipes are written to as they are.
    Raises OutputError, naming the file, where the disk is full or nothing can be written there.
    """
    path = Path(path)
    try:
        target = Path(os.path.realpath(path))  # a link goes on pointing where it does
        if target.exists() and not target.is_file() and not target.is_dir():
            yield target
            return
        beside = _beside(target)
        try:
            yield beside
            _onto_disk(beside)
            beside.replace(target)
        finally:
            beside.unlink(missing_ok=True)
    except Exception as error:
        cause = _of_the_system(error)
        if cause is None:
            raise
        raise _named(path, cause) from error


def write_text(path: str | Path, text: str) -> Path:
    """Write a text as UTF-8, whole or not at all."""
    with replacing(path) as file:
        file.write_text(text, encoding="utf-8")
    return Path(path)


def _beside(target: Path) -> Path:
    """Make an empty file in the same folder, with the same ending and permissions."""
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if target.exists() and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    beside = target.with_name(f".vlmb-{secrets.token_hex(6)}{target.suffix}")
    os.close(os.open(beside, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    if target.exists():
        with contextlib.suppress(OSError):
            shutil.copymode(target, beside)
    return beside


def _onto_disk(path: Path) -> None:
    """Wait until a file is on the disk: a name that points to lost content would be worse than the old one."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _of_the_system(error: BaseException | None) -> OSError | None:
    """Return what the system said that led to an error: writers of files wrap it, and fail once more as they close."""
    found = None
    if isinstance(error, VlmbError):
        return None
    while error is not None:
        if isinstance(error, OSError):
            found = error
        error = error.__cause__ or error.__context__
    return found


def _named(path: Path, cause: OSError) -> OutputError:
    """Say which file could not be written, why, and what to do."""
    if cause.errno in FULL:
        advice = "make room, or write to another place"
    elif cause.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        advice = "writing is not allowed there; write to another place"
    elif cause.errno == errno.ENOENT:
        advice = "its folder does not exist"
    else:
        advice = "write to another place"
    kept = "; the file that stood there is as it was" if path.is_file() else ""
    why = os.strerror(cause.errno) if cause.errno else str(cause) or type(cause).__name__
    return OutputError(f"{path}: cannot be written: {why}: {advice}{kept}")
