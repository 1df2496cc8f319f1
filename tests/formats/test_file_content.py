"""Only regular files up to a size are read."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import read_file


def test_sockets_devices_folders_and_large_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(bytes(11))
    os.mknod(tmp_path / "socket", stat.S_IFSOCK | 0o600)
    refused = {
        tmp_path / "large": "has 11 bytes; 10 are the most",
        tmp_path / "socket": "not a regular file",
        Path("/dev/null"): "not a regular file",
        tmp_path: "not a regular file",
        tmp_path / "a\0b": "no file has such a name",
        tmp_path / "absent": r"cannot be read \(No such file",
    }
    for path, words in refused.items():
        with pytest.raises(InvalidInput, match=words):
            read_file(path, 10)
    assert read_file(tmp_path / "large", 11) == bytes(11)
