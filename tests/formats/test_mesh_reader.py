"""Each mesh file is read within limits of memory and processor time."""

import errno
import json
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.formats import mesh_reader
from pipeline.formats.mesh_file import parse_mesh
from pipeline.formats.mesh_reader import load_mesh
from vt_pipeline.objects import load_object

BOX = trimesh.creation.box((1, 2, 3))


@pytest.fixture
def reader_of(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Let the process that reads mesh files evaluate an expression of `file` and `root` in place of parsing."""
    imports = "import os; from pipeline.formats import mesh_file; from pipeline.formats.mesh_reader import serve"
    keep = "parse_mesh = mesh_file.parse_mesh"

    def replace(expression: str) -> None:
        mesh_reader.end_reader()
        monkeypatch.setattr(mesh_reader, "START", f"{imports}; {keep}; mesh_file.parse_mesh = lambda file, root: {expression}; serve()")

    yield replace
    mesh_reader.end_reader()


def test_file_that_needs_too_much_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_reader, "BYTES", 2**20)  # which any process has already: nothing more is granted
    trimesh.creation.icosphere(subdivisions=5).export(tmp_path / "ball.ply")
    message = r"^ball\.ply needs more than 0\.0 GB of memory to read; decimate the mesh, .* or write it as binary PLY$"
    with pytest.raises(InvalidInput, match=message):
        load_mesh(tmp_path / "ball.ply")


def test_file_that_takes_too_long_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reader_of: Callable[[str], None]) -> None:
    monkeypatch.setattr(mesh_reader, "SECONDS", 1)
    reader_of("sum(iter(int, 1))")  # counts until it is stopped
    BOX.export(tmp_path / "box.ply")
    with pytest.raises(InvalidInput, match=r"^box\.ply takes more than 1 s of processor time to read; decimate"):
        load_object(tmp_path / "box.ply")


def test_limits_hold_in_a_thread_and_the_next_file_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reader_of: Callable[[str], None]
) -> None:
    monkeypatch.setattr(mesh_reader, "BYTES", 2**28)
    reader_of("bytearray(2**29) if file.stem == 'large' else parse_mesh(file, root)")
    BOX.export(tmp_path / "box.ply")
    meshes = []

    def read_both() -> None:
        with pytest.raises(InvalidInput, match="needs more than"):
            load_mesh(tmp_path / "large.ply")
        meshes.append(load_mesh(tmp_path / "box.ply"))

    thread = threading.Thread(target=read_both)
    thread.start()
    thread.join()
    assert [len(mesh.faces) for mesh in meshes] == [12]


def test_file_that_ends_its_reader_is_refused(tmp_path: Path, reader_of: Callable[[str], None]) -> None:
    reader_of("os.abort()")
    with pytest.raises(InvalidInput, match=r"^box\.ply ends the process that reads it \(SIGABRT\); write it with another program$"):
        load_mesh(tmp_path / "box.ply")


def test_reader_prints_nothing_when_the_process_that_asked_ends(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    trimesh.creation.icosphere(subdivisions=6).export(tmp_path / "ball.ply")  # more than a pipe holds
    reader = mesh_reader._start()
    assert reader.stdin
    assert reader.stdout
    reader.stdin.write(
        json.dumps(["mesh", str(tmp_path / "ball.ply"), str(tmp_path), mesh_reader.BYTES, mesh_reader.SECONDS]).encode() + b"\n"
    )
    reader.stdin.close()
    reader.stdout.close()
    assert reader.wait() == errno.EIO
    assert capfd.readouterr().err == ""


def test_forked_process_starts_its_own_reader(tmp_path: Path) -> None:
    BOX.export(tmp_path / "box.ply")
    load_mesh(tmp_path / "box.ply")
    fork = os.fork()
    if not fork:
        try:
            load_mesh(tmp_path / "box.ply")
            mesh_reader.end_reader()
            os._exit(0)
        finally:
            os._exit(1)
    assert os.waitpid(fork, 0)[1] == 0
    assert len(load_mesh(tmp_path / "box.ply").faces) == 12


@pytest.mark.parametrize("suffix", ["ply", "glb"])
def test_mesh_from_the_reader_process_equals_one_parsed_in_this_process(tmp_path: Path, suffix: str) -> None:
    box = BOX.copy()
    box.visual.vertex_colors = np.arange(32, dtype=np.uint8).reshape(8, 4)
    box.export(tmp_path / f"box.{suffix}")
    from_reader, parsed = load_mesh(tmp_path / f"box.{suffix}"), parse_mesh(tmp_path / f"box.{suffix}", tmp_path)
    for value, expected in (
        (from_reader.vertices, parsed.vertices),
        (from_reader.faces, parsed.faces),
        *zip(vars(from_reader.look).values(), vars(parsed.look).values(), strict=True),
    ):
        np.testing.assert_array_equal(value, expected, strict=True)
