"""The content of files that a user or a stranger gives."""

from __future__ import annotations

import stat
from pathlib import Path

from pipeline.errors import InvalidInput


def read_file(path: Path, most: int) -> bytes:
    """Read a file.

    Parameters
    ----------
    path
        A regular file: a pipe may never say anything, a device never end.
    most
        Bytes that it may have.

    Raises
    ------
    InvalidInput
        The file cannot be read, is no regular one, or is larger.
    """
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            raise InvalidInput(f"{path} is no regular file; give the path of one")
        if found.st_size > most:
            raise InvalidInput(f"{path} has {found.st_size} bytes; {most} are the most that are read")
        return path.read_bytes()
    except OSError as error:
        raise InvalidInput(f"{path} cannot be read ({error.strerror}); give the path of a file that can") from error
