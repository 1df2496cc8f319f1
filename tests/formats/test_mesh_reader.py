"""Each mesh file is read within limits of memory and processor time."""

from __future__ import annotations

import errno
import json
import os
import re
import threading
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.formats import mesh_reader
from pipeline.formats.mesh_file import load_mesh, parse_mesh
from vt_pipeline.objects import load_object

BOX = trimesh.creation.box((1, 2, 3))
SPACE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"


def collada(path: Path, body: str, nodes: str = "") -> Path:
    """Write a box whose scene is a node with this body; GEOMETRY stands for the box, and `nodes` can be named."""
    text = BOX.export(file_type="dae").decode()
    before, _, rest = text.partition("<library_visual_scenes>")
    url = re.search(r'instance_geometry url="([^"]*)"', rest)
    scene = f'<visual_scene id="scene"><node id="root">{body}</node></visual_scene>'
    content = f"<library_nodes>{nodes}</library_nodes><library_visual_scenes>{scene}</library_visual_scenes>"
    content += '<scene><instance_visual_scene url="#scene"/></scene></COLLADA>'
    path.write_text(before + content.replace("GEOMETRY", f'<instance_geometry url="{url[1] if url else ""}"/>'))
    return path


def instances_of_instances(folder: Path) -> Path:
    levels = (f'<node id="n{level}">{f"""<instance_node url="#n{level - 1}"/>""" * 10}</node>' for level in range(1, 10))
    return collada(folder / "levels.dae", '<instance_node url="#n9"/>', f'<node id="n0">GEOMETRY</node>{"".join(levels)}')


def instances_of_a_geometry(folder: Path) -> Path:
    return collada(folder / "many.dae", "GEOMETRY" * 200_000)


def millions_of_vertices(folder: Path) -> Path:
    path = folder / "nine.3mf"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("3D/3dmodel.model", "w") as model:
        model.write(f'<model xmlns="{SPACE}"><resources><object id="1"><mesh><vertices>'.encode())
        for _ in range(90):
            model.write(b'<vertex x="0" y="0" z="0"/>' * 100_000)
        triangle = '</vertices><triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh></object></resources>'
        model.write(f'{triangle}<build><item objectid="1"/></build></model>'.encode())
    return path


@pytest.mark.parametrize("make", [instances_of_instances, instances_of_a_geometry, millions_of_vertices])
def test_small_file_that_expands_to_gigabytes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: Callable[[Path], Path]
) -> None:
    monkeypatch.setattr(mesh_reader, "BYTES", 2**28)
    path = make(tmp_path)
    message = rf"^{path.name} needs more than 0\.3 GB of memory to read; decimate the mesh, .* or write it as binary PLY$"
    with pytest.raises(InvalidInput, match=message):
        load_mesh(path)


def test_missing_buffer_is_named_whatever_its_name(tmp_path: Path) -> None:
    (tmp_path / "memory_card.gltf").write_bytes(
        BOX.export(file_type="gltf")["model.gltf"].replace(b"gltf_buffer_1.bin", b"memory_card.bin")
    )
    with pytest.raises(InvalidInput, match=r"memory_card\.bin is missing or cut off: 96 bytes are needed, there are 0"):
        load_mesh(tmp_path / "memory_card.gltf")


def test_file_that_takes_too_long_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_reader, "SECONDS", 1)
    path = instances_of_instances(tmp_path)
    with pytest.raises(InvalidInput, match=r"^levels\.dae takes more than 1 s of processor time to read; decimate"):
        load_object(path)


def test_limits_hold_in_threads_and_the_next_file_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_reader, "BYTES", 2**28)
    BOX.export(tmp_path / "box.ply")
    path, meshes = instances_of_instances(tmp_path), []

    def read_both() -> None:
        with pytest.raises(InvalidInput, match="needs more than"):
            load_mesh(path)
        meshes.append(load_mesh(tmp_path / "box.ply"))

    threads = [threading.Thread(target=read_both) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [len(mesh.faces) for mesh in meshes] == [12, 12]


def test_file_that_crashes_its_reader_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    crash = "import os; from pipeline.formats.mesh_reader import serve; serve(lambda file, root: os.abort())"
    mesh_reader.end_reader()
    monkeypatch.setattr(mesh_reader, "START", crash)
    try:
        with pytest.raises(InvalidInput, match=r"^box\.ply ends the process that reads it \(SIGABRT\); write it with another program$"):
            load_mesh(tmp_path / "box.ply")
    finally:
        mesh_reader.end_reader()


def test_reader_prints_nothing_when_the_process_that_asked_ends(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    trimesh.creation.icosphere(subdivisions=6).export(tmp_path / "ball.ply")  # more than a pipe holds
    reader = mesh_reader._start()
    assert reader.stdin
    assert reader.stdout
    reader.stdin.write(json.dumps([str(tmp_path / "ball.ply"), str(tmp_path), mesh_reader.BYTES, mesh_reader.SECONDS]).encode() + b"\n")
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
