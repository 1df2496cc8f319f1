"""Files of poses that are none, or would take memory without end."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InvalidInput
from pipeline.inference.grasp_input_files import read_poses

EYE = np.eye(4).tolist()
HUGE = [[1e200, 1e200, 0, 0], [1e200, -1e200, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({}, "no list of poses"),
        ("four", "no list of poses"),
        ({"poses": None}, "no list of poses"),
        ([[1, 2], [3, 4]], r"\(2, 2\)"),
        ([[1, 2], [3]], "inhomogeneous"),
        ([], r"\(0,\)"),
        ([[[10**400] * 4] * 4], r"object \(1, 4, 4\)"),
        ([[["1"] * 4] * 4], "must be numbers"),
        ({"poses": [EYE], "touched": [1]}, "true or false"),
        ({"poses": [EYE], "touched": [True, False]}, "each of the 1 poses"),
        ({"poses": [EYE], "touched": [[True], []]}, "inhomogeneous"),
        ([(2 * np.eye(4)).tolist()], "pose 0: .*rigid"),
        ([HUGE], "pose 0: .*rigid"),
        ([[[1, 0, 0, 600], *np.eye(4)[1:].tolist()]], "pose 0 is 600 m away; poses are in metres"),
        ([np.full((4, 4), np.inf).tolist()], "infinity"),
    ],
)
def test_json_poses_that_are_none_are_errors(tmp_path: Path, content: object, words: str) -> None:
    path = tmp_path / "poses.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InvalidInput, match=words):
        read_poses(path)


@pytest.mark.parametrize("content", [b"[" * 100_000, b"{", b"\xff", b"9" * 5000, b""], ids=["nested", "cut", "bytes", "digits", "empty"])
def test_json_that_cannot_be_parsed_is_an_error(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "poses.json").write_bytes(content)
    with pytest.raises(InvalidInput, match="holds no sensor poses"):
        read_poses(tmp_path / "poses.json")


def npz(header: str, values: bytes, compression: int = zipfile.ZIP_STORED) -> bytes:
    array, file = b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little") + header.encode() + values, io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as archive:
        archive.writestr("poses.npy", array)
    return file.getvalue()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (npz("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 4, 4)}", bytes(128)), "claims float64 .* has 128 bytes"),
        (npz("{'descr': '|O', 'fortran_order': False, 'shape': (1, 4, 4)}", bytes(128)), "claims object"),
        (npz("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 4, 4)}", bytes(128)), "claims float64"),
        (npz("x" * 100, bytes(128)), "holds no sensor poses"),
        (npz("", bytes(2**21), zipfile.ZIP_DEFLATED), "1048576 are the most"),
        (npz("", b"", zipfile.ZIP_LZMA), "stored or deflated"),
        (b"PK\5\6" + bytes(18), "'poses'"),
        (b"no zip", "not a zip file"),
    ],
    ids=["shape", "objects", "negative", "header", "bomb", "lzma", "empty", "none"],
)
def test_npz_poses_are_checked_before_memory_is_taken(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "poses.npz").write_bytes(content)
    with pytest.raises(InvalidInput, match=words):
        read_poses(tmp_path / "poses.npz")
