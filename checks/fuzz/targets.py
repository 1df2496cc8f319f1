"""Fuzzing targets: everything that opens files of users or strangers."""

import io
import json
import os
import pickle
import struct
import sys
import tempfile
import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml
from PIL import Image

from checks.fuzz.predict_target import Predictions
from checks.fuzz.store_target import Stores
from checks.fuzz.target import Files, Target
from pipeline.cluster.slurm_jobs import Submission, load_cluster, plan_jobs, script_of
from pipeline.config import folder_sources
from pipeline.config.manifest import load_manifest
from pipeline.config.sources import fingerprint
from pipeline.errors import InvalidInput
from pipeline.formats.file_units import stated_units
from pipeline.formats.grasp_file import read_grasp_file
from pipeline.formats.hand_file import load_hand
from pipeline.formats.mesh_reader import load_mesh
from pipeline.formats.scene_file import load_scene
from pipeline.formats.sensor_file import load_sensor
from pipeline.formats.threemf import MODEL
from stages.registry import load_stage, resolve
from tests.formats.gltf_builder import Gltf, glb
from tests.formats.test_collada import ARROW, FILE, POLYGONS, POLYLIST, RED, TEXTURE, TRIANGLE

CALLS = ("exec", "pickle.", "os.", "subprocess.", "socket.", "shutil.", "ctypes.", "marshal.", "code.")
"""Audit events of what a file of grasps must not lead to: https://docs.python.org/3/library/audit_events.html."""
MJCF = b"""<mujoco>
<compiler angle="radian" eulerseq="zyx"/>
<default><geom size="0.01"/><default class="tip"><geom type="mesh" mesh="tip" mass="0.01"/></default></default>
<asset><mesh name="tip" file="tip.obj" scale="1 1 2"/><material name="red" rgba="1 0 0 1"/></asset>
<worldbody><body name="palm"><freejoint/><geom type="box" size="0.025 0.025 0.01" euler="0 0 1"/>
<body name="left" pos="-0.02 0 0.02"><joint name="left-joint" axis="0 1 0" range="-0.5 1.5" ref="0.1" damping="0.1"/>
<joint name="spread" type="slide" axis="1 0 0" range="0 0.01"/>
<geom class="tip" material="red"/></body>
<include file="right.xml"/></body></worldbody>
<tendon><fixed name="pull"><joint joint="left-joint" coef="1"/><joint joint="spread" coef="-0.5"/></fixed></tendon>
<equality><joint joint1="bent" joint2="right-joint" polycoef="0 1 0 0 0"/></equality>
<contact><exclude body1="left" body2="right"/></contact>
<actuator><position joint="right-joint" kp="1" ctrlrange="0 1" forcerange="-1 1"/>
<motor tendon="pull" gear="0.2"/></actuator></mujoco>"""
INCLUDED = b"""<mujocoinclude>
<body name="right" pos="0.02 0 0.02" quat="1 0 0.1 0"><joint name="right-joint" axis="0 1 0" range="-0.5 1.5"/>
<geom type="capsule" fromto="0 0 0 0 0 0.02"/>
<body name="tip" pos="0 0 0.03"><joint name="bent" axis="0 1 0"/><geom type="ellipsoid" size="0.01 0.01 0.02"/></body></body>
</mujocoinclude>"""
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
        manifests: list[dict[str, Any]] = [{**common, "sources": one} for one in sources]
        manifests.append({**common, "splits": {"train": 2, "valid": 1, "test": 0}, "sources": sources[0]})
        return [{"manifest.yaml": dump(one).encode(), **mesh} for one in manifests for dump in (json.dumps, yaml.safe_dump)]

    def read(self, folder: Path, files: Files) -> None:
        os.chdir(folder)
        folder_sources.MAX_ENTRIES = 1000  # some manifests name the root of the file system
        load_manifest("manifest.yaml").objects(folder / "meshes")


class Hands(Target):
    """Hand files with their URDF or MJCF and its meshes."""

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
        of_mjcf = json.dumps(hand | {"urdf": "hand.xml"}).encode()
        return [
            {"hand.yaml": json.dumps(hand).encode(), "hand.urdf": urdf, "tip.obj": tip},
            {"hand.yaml": of_mjcf, "hand.xml": MJCF, "right.xml": INCLUDED, "tip.obj": tip},
        ]

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
        looks += _colored(texture)
        exported = trimesh.Scene(box).export(file_type="gltf")
        looks.append({"mesh.gltf" if name.endswith(".gltf") else name: content for name, content in exported.items()})
        return looks

    def read(self, folder: Path, files: Files) -> None:
        file = folder / next(name for name in files if name.startswith("mesh."))
        stated_units(file)
        fingerprint({"file": str(file), "root": str(folder)})
        load_mesh(file, folder)


def _colored(texture: bytes) -> list[Files]:
    """Write meshes with colours and pages of textures: OFF, STL, and PLY with polygons and strips, in text and binary."""
    corners = ("0 0 0", "1 0 0", "1 1 0", "0 1 0")
    off = "\n".join(["COFF", "4 1 0", *(f"{corner} 1 0 0.5 1" for corner in corners), "4 0 1 2 3 9 9 9", ""]).encode()
    head = "ply\nformat {} 1.0\ncomment TextureFile a.png\ncomment TextureFile b.png\nelement vertex 4\n"
    head += "".join(f"property float {name}\n" for name in ("x", "y", "z", "diffuse_red", "diffuse_green", "diffuse_blue"))
    head += "element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nproperty uchar texnumber\n"
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    faces = ((0, 1, 2, 3), (0, 0, 1, 0, 1, 1, 0, 1), 1), ((0, 1, 2), (0, 0, 1, 0, 1, 1), 0)
    rows = [f"{corner} 1 0.5 0" for corner in corners]
    rows += [f"{len(face)} {' '.join(map(str, face))} {len(uv)} {' '.join(map(str, uv))} {page}" for face, uv, page in faces]
    text = head.format("ascii") + "\n".join([*rows, "5 0 1 2 -1 3", ""])
    binary = head.format("binary_big_endian").encode() + np.array([corner.split() + [1, 0.5, 0] for corner in corners], ">f4").tobytes()
    for face, uv, page in faces:
        binary += struct.pack(f">B{len(face)}iB{len(uv)}fB", len(face), *face, len(uv), *uv, page)
    binary += struct.pack(">6i", 5, 0, 1, 2, -1, 3)
    stl = b"COLOR=1234".ljust(80) + struct.pack("<I12fH12fH", 2, *range(12), 0x1234, *range(12, 24), 0x8000) + b"behind"
    pages = {"a.png": texture, "b.png": texture}
    return [{"mesh.off": off}, {"mesh.stl": stl}, {"mesh.ply": text.encode(), **pages}, {"mesh.ply": binary, **pages}]


class Gltfs(Meshes):
    """glTF files: a skin, morph targets, instances, a texture with a sampler, sparse and normalised arrays; as JSON and as GLB."""

    def sound(self) -> list[Files]:
        document = Gltf()
        document.texture([[[200, 30, 30, 90], [0, 0, 255, 255]]], sampler=document.add("samplers", {"wrapS": 33071, "wrapT": 33648}))
        corners, weights = np.tile(np.uint8([0, 1, 0, 0]), (8, 1)), np.tile(np.float32([0.5, 0.25, 0, 0]), (8, 1))
        uv, colors = np.linspace(-1, 2, 16, dtype=np.float32).reshape(8, 2), np.full((8, 4), 0.5, np.float32)
        part = document.box(JOINTS_0=corners, WEIGHTS_0=weights, TEXCOORD_1=uv, COLOR_0=colors) | {"material": 0}
        part["targets"] = [{"POSITION": document.sparse([0, 5], np.ones((2, 3), np.float32), 8)}]
        binds = document.array(np.tile(np.eye(4, dtype=np.float32).reshape(1, 16), (2, 1)))
        places = {
            "TRANSLATION": document.array(np.eye(3, dtype=np.float32)),
            "ROTATION": document.array(np.int8(np.eye(4)[:3] * 127), normalized=True),
        }
        nodes = [
            {"mesh": 0, "skin": 0, "weights": [0.5]},
            {"rotation": [0, 0, 0.6, 0.8], "children": [2]},
            {"mesh": 1, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": places}}},
        ]
        transform = {"KHR_texture_transform": {"offset": [0.5, 0], "rotation": 1, "scale": [2, 1]}}
        rough = {"baseColorFactor": [0, 0, 0, 0.5], "baseColorTexture": {"index": 0, "texCoord": 1, "extensions": transform}}
        material = {
            "pbrMetallicRoughness": rough,
            "emissiveFactor": [0, 1, 0],
            "emissiveTexture": {"index": 0, "texCoord": 1},
            "alphaMode": "MASK",
        }
        meshes = [{"primitives": [part], "weights": [1]}, {"primitives": [document.box() | {"mode": 5}]}]
        skins = [{"joints": [1, 2], "inverseBindMatrices": binds}]
        with tempfile.TemporaryDirectory() as folder:
            entries = {"nodes": nodes, "meshes": meshes, "skins": skins, "materials": [material], "scenes": [{"nodes": [0, 1]}]}
            text = document.write(Path(folder) / "a.gltf", **entries).read_bytes()
        return [{"mesh.gltf": text}, {"mesh.glb": glb(text)}]


class Collada(Meshes):
    """COLLADA files: instances of nodes and of geometries, and a texture."""

    def sound(self) -> list[Files]:
        plain = TRIANGLE.replace("SHADER", RED).replace("><", ">\n<").encode()
        head, _, rest = plain.partition(b"<library_visual_scenes>")
        geometry = (
            b"<instance_geometry" + rest.partition(b"<instance_geometry")[2].partition(b"</instance_geometry>")[0] + b"</instance_geometry>"
        )
        three = b'<node id="n1">\n%s</node>\n' % (b'<instance_node url="#n0"/>\n' * 3)
        scene = b'<visual_scene id="scene"><node id="r">\n<matrix>1 0 0 2 0 1 0 0 0 0 1 0 0 0 0 1</matrix>\n'
        scene += b'<instance_node url="#n1"/>\n' + geometry + b"</node></visual_scene></library_visual_scenes>"
        nodes = b'<library_nodes>\n<node id="n0">' + geometry + b"</node>\n" + three + b"</library_nodes>\n<library_visual_scenes>"
        nested = head + nodes + scene + b'<scene><instance_visual_scene url="#scene"/></scene></COLLADA>'
        polygons = FILE.replace("NUMBERS", ARROW).replace("POLYGONS", POLYLIST + POLYGONS).replace("><", ">\n<").encode()
        painted = TRIANGLE.replace("SHADER", TEXTURE).replace("><", ">\n<").encode()
        texture = _png(np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
        return [{"mesh.dae": plain}, {"mesh.dae": nested}, {"mesh.dae": polygons}, {"mesh.dae": painted, "a.png": texture}]


class ThreeMF(Meshes):
    """3MF files: whole archives in every compression, and the parts that one is made of."""

    def sound(self) -> list[Files]:
        made = zipfile.ZipFile(io.BytesIO(trimesh.Scene([trimesh.creation.box(), trimesh.creation.box()]).export(file_type="3mf")))
        parts = {name: made.read(name) for name in made.namelist()}
        components = b"".join(
            b'<object id="%d" type="model"><components>%s</components></object>\n' % (number, inner)
            for number, inner in ((8, b'<component objectid="1"/>\n<component objectid="2"/>\n'), (9, b'<component objectid="8"/>\n' * 3))
        )
        items = b'<item objectid="9" transform="1 0 0 0 1 0 0 0 1 5 5 5"/>\n<item objectid="9"/>\n</build>'
        model = parts[MODEL].replace(b"</resources>", components + b"</resources>").replace(b"</build>", items)
        parts[MODEL] = model.replace(b"><vertex", b">\n<vertex").replace(b"><triangle", b">\n<triangle")
        groups = b"""<m:texture2d id="11" path="/3D/a.png" contenttype="image/png"/>
<m:texture2dgroup id="12" texid="11"><m:tex2coord u="0" v="1"/><m:tex2coord u="1" v="1"/></m:texture2dgroup>
<m:colorgroup id="13"><m:color color="#DC1414FF"/><m:color color="#1414DC"/></m:colorgroup>
"""
        painted = parts[MODEL].replace(b"<resources>", b"<resources>\n" + groups)
        painted = painted.replace(b"<triangle ", b'<triangle pid="12" p1="0" p2="1" ', 6).replace(
            b"<triangle v", b'<triangle pid="13" p1="0" p3="1" v'
        )
        painted = painted.replace(b"<item ", b'<item p:path="/3D/b.model" objectid="1"/>\n<item ', 1)
        colored = {**parts, MODEL: painted, "3D/a.png": _png(np.zeros((2, 2, 3), np.uint8)), "3D/b.model": parts[MODEL]}
        whole = [
            {"mesh.3mf": _packed(parts, kind)} for kind in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
        ]
        return [*whole, *[{f"parts/{name}": content for name, content in of.items()} for of in (parts, colored)] * 3]

    def read(self, folder: Path, files: Files) -> None:
        if "mesh.3mf" not in files:
            parts = {name.removeprefix("parts/"): content for name, content in files.items()}
            (folder / "mesh.3mf").write_bytes(_packed(parts, zipfile.ZIP_DEFLATED))
        stated_units(folder / "mesh.3mf")
        load_mesh(folder / "mesh.3mf", folder)


class Grasps(Target):
    """Files of grasps: arrays, and pickles of DexGraspBench and DexGraspNet, none of which may call anything that they name."""

    def __init__(self) -> None:
        super().__init__()
        self.events: list[str] = []
        for module in ("encodings.cp437", "encodings.raw_unicode_escape", "tokenize"):  # imported by the standard library when needed first
            import_module(module)
        sys.addaudithook(lambda event, _: self.events.append(event) if event.startswith(CALLS) else None)

    def sound(self) -> list[Files]:
        joints, qpos = np.array(["a", "b"]), np.array([0, 0, 0.1, 1, 0, 0, 0, 0.5, 0.2], np.float32)
        bench = {"obj_path": "a", "obj_scale": np.float64(0.1), "obj_pose": np.eye(7)[3], "grasp_qpos": qpos, "squeeze_qpos": qpos}
        net = {"qpos": dict.fromkeys(("WRJTx", "WRJTy", "WRJTz", "WRJRx", "WRJRy", "WRJRz", "a", "b"), 0.25), "scale": 0.1}
        pickles = [bench, bench | {"grasp_qpos": np.stack([qpos, qpos]), "joint_names": joints}, [net, net]]
        arrays = {"hand_pose": np.eye(4)[None], "joint_angles": np.ones((1, 2)), "joint_names": joints, "metres_per_unit": np.array(0.1)}
        files = []
        for write in (np.savez, np.savez_compressed):
            write(stream := io.BytesIO(), **arrays)
            files.append({"grasps.npz": stream.getvalue()})
        for protocol in (3, 4):
            for content in pickles:
                array = np.array(content, object)
                np.lib.format.write_array_header_1_0(stream := io.BytesIO(), np.lib.format.header_data_from_array_1_0(array))
                files.append({"grasps.npy": stream.getvalue() + pickle.dumps(array, protocol)})
        return files

    def read(self, folder: Path, files: Files) -> None:
        self.events.clear()
        refusals = [grasp.stated for grasp in read_grasp_file(folder / next(iter(files)), folder) if isinstance(grasp.stated, InvalidInput)]
        if self.events:
            raise AssertionError(f"a file of grasps led to {self.events}")
        if refusals:
            raise refusals[0]


def _packed(parts: Files, compression: int) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return file.getvalue()


def _png(pixels: np.ndarray) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


TARGETS: dict[str, tuple[type[Target], Any]] = {
    "sensor files": (Sensors, 0.25),
    "scene files": (Scenes, 0.25),
    "manifests": (Manifests, 0.15),
    "cluster files": (Clusters, 0.05),
    "hand files": (Hands, 0.1),
    "mesh files": (Meshes, 0.1),
    "glTF files": (Gltfs, 0.05),
    "COLLADA files": (Collada, 0.05),
    "3MF files": (ThreeMF, 0.05),
    "grasp files": (Grasps, 0.1),
    "predict": (Predictions, 0.1),
    "store": (Stores, 0.05),
}
"""Each target with its share of the inputs."""
