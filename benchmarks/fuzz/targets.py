"""What is fuzzed: whatever opens a file that a user, or a stranger, may have written."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml
from PIL import Image

from benchmarks.fuzz.predict_target import Predictions
from benchmarks.fuzz.store_target import Stores
from benchmarks.fuzz.target import Files, Target
from pipeline.config import sources
from pipeline.config.cluster_profile import load_cluster
from pipeline.config.hand_file import load_hand
from pipeline.config.manifest import load_manifest
from pipeline.config.mesh_file import load_mesh
from pipeline.config.scene_file import load_scene
from pipeline.config.sensor_file import load_sensor
from pipeline.config.sources import fingerprint
from pipeline.engine.slurm_jobs import Submission, plan_jobs, script_of
from stages.registry import load_stage, resolve

ASSETS = Path(__file__).parents[2] / "pipeline" / "assets"


class Sensors(Target):
    """Sensor files."""

    def sound(self) -> list[Files]:
        return [{"sensor.yaml": path.read_bytes()} for path in sorted((ASSETS / "sensors").glob("*.yaml"))]

    def read(self, folder: Path, files: Files) -> None:
        load_sensor(str(folder / "sensor.yaml"))


class Scenes(Target):
    """Scene files."""

    def sound(self) -> list[Files]:
        return [{"scene.yaml": path.read_bytes()} for path in sorted((ASSETS / "scenes").glob("*.yaml"))]

    def read(self, folder: Path, files: Files) -> None:
        load_scene(str(folder / "scene.yaml"))


class Clusters(Target):
    """Cluster files, and the scripts that they make."""

    def sound(self) -> list[Files]:
        shipped = (ASSETS / "clusters" / "slurm.yaml").read_bytes()
        full = yaml.safe_load(shipped) | {"account": "lab", "command": "vt", "setup": ["module load mesa"], "options": ["--qos=long"]}
        return [{"cluster.yaml": content} for content in (shipped, json.dumps(full).encode())]

    def read(self, folder: Path, files: Files) -> None:
        submission = Submission(load_cluster(folder / "cluster.yaml"), (), 2, Path("/data"), Path("/data"))
        for name in ("simulate-touch", "train-unet"):
            (job,) = plan_jobs([(load_stage(name), resolve(name, "draft", ["accelerator=cuda"] if name == "train-unet" else []))])
            lines = script_of(job, submission).split("\n")
            if not all(map(str.isprintable, lines)):
                raise AssertionError(f"a script with control characters: {lines}")


class Manifests(Target):
    """Manifests, and the folders that they name."""

    def sound(self) -> list[Files]:
        splits = {"train": 0.5, "valid": 0.25, "test": 0.25}
        common = {"name": "m", "description": "d", "seed": 0, "splits": splits}
        sources = [
            [{"kind": "procedural", "licence": "MIT", "seed": 0, "count": {"bottle": 1, "knife": 2}}],
            [{"kind": "directory", "licence": "x", "up": "z", "path": "meshes", "metres_per_unit": 0.001}],
            [{"kind": "shapenet", "licence": "x", "up": "y", "path": "shapenet", "synsets": {"mug": "1"}, "counts": {"mug": 1}}],
            [{"kind": "pybullet", "licence": "zlib", "up": "z", "files": {"duck": {"file": "duck.obj", "up": "y"}}, "random_urdfs": 2}],
        ]
        mesh = {"meshes/a/b.obj": b"v 0 0 0\n", "shapenet/1/x/model.obj": b"v 0 0 0\n"}
        return [{"manifest.yaml": json.dumps({**common, "sources": one}).encode(), **mesh} for one in sources]

    def read(self, folder: Path, files: Files) -> None:
        os.chdir(folder)
        sources.MAX_ENTRIES = 1000  # some manifests name the root of the file system
        load_manifest("manifest.yaml").objects(folder / "meshes")


class Hands(Target):
    """Hand files with their URDF and its meshes."""

    def sound(self) -> list[Files]:
        hand = {
            "name": "pincer",
            "urdf": "hand.urdf",
            "sensor": "gel_16mm",
            "palm": {"link": "palm", "facing": [0, 0, 1], "centre": [0, 0, 0.02]},
            "fingers": [
                {
                    "name": name,
                    "joints": [f"{name}-joint"],
                    "sensor": {"link": name, "origin": [0, 0, 0.05], "normal": [1, 0, 0], "columns": [0, 1, 0]},
                }
                for name in ("left", "right")
            ],
        }
        links = "".join(
            f'<link name="{name}"><visual><origin xyz="0 0 0.02" rpy="0 0 0"/><geometry>{shape}</geometry></visual>'
            f"<collision><geometry>{shape}</geometry></collision></link>"
            for name, shape in (
                ("palm", '<box size="0.05 0.05 0.02"/>'),
                ("left", '<mesh filename="tip.obj"/>'),
                ("right", '<sphere radius="0.01"/>'),
            )
        )
        joints = "".join(
            f'<joint name="{name}-joint" type="revolute"><parent link="palm"/><child link="{name}"/><origin xyz="{x} 0 0.02"/>'
            '<axis xyz="0 1 0"/><limit lower="-0.5" upper="1.5" effort="1" velocity="1"/></joint>'
            for name, x in (("left", -0.02), ("right", 0.02))
        )
        tip = trimesh.creation.box((0.01, 0.01, 0.02)).export(file_type="obj").encode()
        urdf = f'<robot name="pincer">{links}{joints}</robot>'.encode()
        return [{"hand.yaml": json.dumps(hand).encode(), "hand.urdf": urdf, "tip.obj": tip}]

    def read(self, folder: Path, files: Files) -> None:
        load_hand(str(folder / "hand.yaml"))


class Meshes(Target):
    """Mesh files with their materials and textures: their key, and their triangles."""

    def sound(self) -> list[Files]:
        box = trimesh.creation.box()
        texture = _png(np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
        obj = b"mtllib box.mtl\nvt 0 0\nvt 1 0\nvt 0 1\n" + b"".join(b"v %g %g %g\n" % tuple(vertex) for vertex in box.vertices)
        obj += b"usemtl skin\n" + b"".join(b"f %d/1 %d/2 %d/3\n" % tuple(face + 1) for face in box.faces)
        looks = [{"mesh.obj": obj, "box.mtl": b"newmtl skin\nKd 0.5 0.2 0.1\nmap_Kd skin.png\n", "skin.png": texture}]
        for kind in ("obj", "ply", "stl", "off", "glb"):
            content = box.export(file_type=kind)
            looks.append({f"mesh.{kind}": content.encode() if isinstance(content, str) else content})
        colored = box.copy()
        colored.visual.vertex_colors = np.arange(32, dtype=np.uint8).reshape(8, 4)
        looks.append({"mesh.ply": colored.export(file_type="ply", encoding="ascii")})
        looks.append({"mesh.stl": box.export(file_type="stl_ascii").encode()})
        exported = trimesh.Scene(box).export(file_type="gltf")
        looks.append({"mesh.gltf" if name.endswith(".gltf") else name: content for name, content in exported.items()})
        return looks

    def read(self, folder: Path, files: Files) -> None:
        file = folder / next(name for name in files if name.startswith("mesh."))
        fingerprint({"file": str(file), "root": str(folder)})
        load_mesh(file, folder)


def _png(pixels: np.ndarray) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


TARGETS: dict[str, tuple[type[Target], Any]] = {
    "sensor files": (Sensors, 0.25),
    "scene files": (Scenes, 0.25),
    "manifests": (Manifests, 0.2),
    "cluster files": (Clusters, 0.05),
    "hand files": (Hands, 0.1),
    "mesh files": (Meshes, 0.2),
    "predict": (Predictions, 0.1),
    "store": (Stores, 0.05),
}
"""Each with its share of all inputs."""
