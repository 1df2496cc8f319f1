"""Read files that come from a user or a stranger."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from pipeline.errors import InvalidInput

MESH_SUFFIXES = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf", ".dae", ".3mf")
"""Formats of mesh files that are read; archives are not among them."""


def expanded(path: Path | str) -> Path:
    """Replace a leading `~` or `~USER` by that home folder; `~USER` stays if there is no such user, where pathlib raises."""
    return Path(os.path.expanduser(path))


def regular_stat(path: Path | str) -> os.stat_result:
    """Find size and times of a regular file, and refuse others: a pipe may block for ever, a device may never end.

    Call this before a file that comes from a user or a stranger is opened, here or by a library.

    Raises
    ------
    OSError
        There is no such file; an `IsADirectoryError` for a folder, a pipe, a device or a link to itself.
    """
    try:
        status = os.stat(path)
        regular = stat.S_ISREG(status.st_mode)
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        regular = False
    except ValueError as error:  # a name with a zero byte, which no file has
        raise FileNotFoundError(errno.ENOENT, f"no file has such a name: {error}", str(path)) from error
    if not regular:
        raise IsADirectoryError(errno.EISDIR, "it is not a regular file", str(path))
    return status


def read_file(path: Path, max_bytes: int) -> bytes:
    """Read a file.

    Parameters
    ----------
    path
        A regular file.
    max_bytes
        Maximum size.

    Raises
    ------
    InvalidInput
        The file cannot be read, is not regular, or is larger.
    """
    try:
        if (size := regular_stat(path).st_size) > max_bytes:
            raise InvalidInput(f"{path} has {size} bytes; {max_bytes} are the most that are read")
        return path.read_bytes()
    except OSError as error:
        raise InvalidInput(f"{path} cannot be read ({error.strerror}); give the path of a file that can") from error
