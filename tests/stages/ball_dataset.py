"""A data directory of balls, written by the real runner: what every stage would have made of them, in closed form, and untrained models."""

import atexit
import shutil
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from rich.console import Console

from pipeline.config.settings import Settings
from pipeline.config.sources import Object
from pipeline.engine.make import plans
from pipeline.engine.plan import Request
from pipeline.engine.stage import Cost, Inputs, ObjectStage, Unit
from pipeline.formats.scene_file import load_scene
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.geometry.mesh_cleaning import bounding_diagonal
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.implicit_network import ImplicitNetwork
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS, IMPLICIT_CONFIGURATIONS
from pipeline.kernels.touch.sensor import sensor_to_world
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from pipeline.kernels.touch.touched_points import Touch, chart_touches
from pipeline.kernels.vision.camera import Camera, projection_matrix
from pipeline.models.families import model_name
from pipeline.models.model_files import save_model
from pipeline.models.reconstruction import Trained
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.distances import DISTANCES
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.registry import load_stage, resolve
from tests.engine.tiny_stages import pack, publish

CENTRE = np.array([0.0, 0.0, 0.6])
SCALE, TURN = 0.001, np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Metres per unit of a ball's file, millimetres, and from its axes, y up, to the world's."""
SIDE = 3
GRASPS_AN_OBJECT, SENSORS = 5, 4
SENSOR = load_sensor("gel_16mm")
HAND = {"hand": "allegro_right"}
CAMERA = Camera(name="camera", position=(1.5, 0, 0.6), rotation=(90, 0, 90), focal=(400, 400), centre=(128, 128), resolution=256)


def direction_to(unit: Unit, grasp: int, sensor: int) -> np.ndarray:
    """Compute the direction of a sensor from the ball's centre."""
    drawn = unit.rng("sensor", grasp, sensor).normal(size=3)
    return np.asarray(drawn / np.linalg.norm(drawn))


def radius_of(unit: Unit) -> float:
    return 0.1 + 0.02 * (ord(unit.name[-1]) - ord("a"))


def projection_of(unit: Unit) -> np.ndarray:
    """Zoom the camera as `render-vision` does: a ball is seen as large as an object of 0.5 m."""
    return projection_matrix(CAMERA.zoomed(0.5 / bounding_diagonal(trimesh.creation.icosphere(3, radius_of(unit)).vertices)))


def pose_of(unit: Unit, grasp: int, sensor: int) -> np.ndarray:
    """Point a sensor at the ball's centre, its plane 5 mm from the ball; every fourth is too far away."""
    outward = direction_to(unit, grasp, sensor)
    across = np.cross(outward, np.eye(3)[np.argmin(np.abs(outward))])
    across /= np.linalg.norm(across)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([across, np.cross(-outward, across), -outward], axis=1)
    pose[:3, 3] = CENTRE + outward * (radius_of(unit) + (0.02 if sensor == grasp % SENSORS else 0.005))
    return pose


def depth_of(unit: Unit, grasp: int, sensor: int) -> np.ndarray:
    """Compute the ball's depth map, in closed form."""
    radius, pose = radius_of(unit), pose_of(unit, grasp, sensor)
    gap = np.linalg.norm(pose[:3, 3] - CENTRE)
    along = (np.arange(SENSOR.cols) + 0.5) / SENSOR.cols - 0.5
    squared = (along[None] ** 2 + along[:, None] ** 2) * SENSOR.width**2
    return (gap - np.sqrt(radius**2 - squared)).astype(np.float32)


def surfaces(unit: Unit) -> Row:
    directions = unit.rng("points").normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    flags = {name: np.array(0, np.int32) for name in ("degenerate_faces", "duplicate_faces")}
    ball = trimesh.creation.icosphere(3, radius_of(unit))
    mesh = {
        "meshes/vertices": np.asarray(ball.vertices) + CENTRE,
        "meshes/faces": np.asarray(ball.faces, np.int32),
        "meshes/uv": np.zeros((len(ball.vertices), 2), np.float32),
    }
    look = {
        "meshes/face_material": np.zeros(len(ball.faces), np.int32),
        "meshes/base_color": np.full((1, 4), 255, np.uint8),
        "meshes/material_texture": np.full(1, -1, np.int32),
    }
    points = (CENTRE + radius_of(unit) * directions).astype(np.float32)
    placement = np.block([[SCALE * TURN, CENTRE[:, None]], [np.eye(4)[3:]]])
    described = {"points": points, "normals": directions.astype(np.float32), "watertight": np.array(True), "placement": placement}
    texts = {"source_file": f"ball {unit.name}", "source_sha256": "", "licence": "", "unread": ""}
    source = {"metres_per_unit": np.array(0.0), **{name: np.array(text) for name, text in texts.items()}}
    return described | flags | mesh | look | source


def distances(unit: Unit) -> Row:
    reach = unit.rng("queries").uniform(-0.27, 0.27, (2000, 3))
    return {
        "query_points": (CENTRE + reach).astype(np.float32),
        "signed_distance": (np.linalg.norm(reach, axis=1) - radius_of(unit)).astype(np.float32),
    }


def each_sensor(function: Callable[[Unit, int, int], np.ndarray], unit: Unit) -> np.ndarray:
    return np.array([[function(unit, grasp, sensor) for sensor in range(SENSORS)] for grasp in range(GRASPS_AN_OBJECT)])


def touched(unit: Unit, grasp: int, sensor: int) -> np.ndarray:
    return np.array(sensor != grasp % SENSORS)


def grasps(unit: Unit) -> Row:
    outward, felt = each_sensor(direction_to, unit), each_sensor(touched, unit)
    return {
        "hand_pose": np.tile(np.eye(4), (GRASPS_AN_OBJECT, 1, 1)),
        **{f"{posture}_angles": np.zeros((GRASPS_AN_OBJECT, 16)) for posture in ("pregrasp", "joint", "squeeze")},
        "sensor_pose": each_sensor(pose_of, unit),
        "touch_success": felt,
        "contact_point": np.where(felt[..., None], CENTRE + radius_of(unit) * outward, 0.0),
        "contact_normal": np.where(felt[..., None], -outward, 0.0),
        "contact_area": np.where(felt, 1e-5, 0.0).astype(np.float32),
        **{name: np.zeros(GRASPS_AN_OBJECT, np.float32) for name in ("opposition", "closure", "penetration")},
        "attempts": np.array(5, np.int32),
        "attempt_success": np.full(SENSORS, 0.75, np.float32),
    }


def vision(unit: Unit) -> Row:
    rng = unit.rng("image")
    shape = (GRASPS_AN_OBJECT, CAMERA.resolution, CAMERA.resolution)
    images = rng.integers(0, 256, (1 + GRASPS_AN_OBJECT, *shape[1:], 3), dtype=np.uint8)
    row, col = np.indices(shape[1:]) - CAMERA.resolution / 2
    segmentation = np.zeros((1 + shape[0], *shape[1:]), np.uint8)
    segmentation[0] = np.hypot(row, col) < 400 * radius_of(unit)  # not to scale, but larger for larger balls
    views = {"unoccluded": images[:1], "occluded": images[1:, None], "segmentation": segmentation[:, None]}
    return views | {"projection": np.tile(projection_of(unit), (1 + GRASPS_AN_OBJECT, 1, 1, 1))}


def touch(unit: Unit) -> Row:
    depth = each_sensor(depth_of, unit)
    tactile_images = np.array([[tactile_image(one, SENSOR) for one in grasp] for grasp in depth])
    return {"depth": depth, "tactile_image": tactile_images}


def chart_of(unit: Unit, grasp: int, sensor: int) -> np.ndarray:
    """Lay the sensor's square on the ball where it touches."""
    flat = chart_square(SIDE)[0].numpy() * SENSOR.width
    square = sensor_to_world(pose_of(unit, grasp, sensor), flat[:, 0], flat[:, 1], flat[:, 2])
    if not touched(unit, grasp, sensor):
        return square
    outward = square - CENTRE
    return np.asarray(CENTRE + radius_of(unit) * outward / np.linalg.norm(outward, axis=1, keepdims=True))


def chart_touches_of_ball() -> tuple[Touch, ...]:
    """Make the touches of the first grasp of the ball a, three of four sensors of which touch it."""
    unit = Unit(name="a")
    return chart_touches(each_sensor(chart_of, unit)[0], each_sensor(touched, unit)[0])


def charts(unit: Unit) -> Row:
    felt = each_sensor(touched, unit)
    return {
        "vertices": each_sensor(chart_of, unit).astype(np.float32),
        "residual": np.where(felt, 2e-4, 0).astype(np.float32),
        "iterations": np.where(felt, 80, 0).astype(np.int32),
        "stop_rule": felt.astype(np.uint8),
    }


LABELS: Row = {
    "grasp": np.arange(5, dtype=np.int32),
    "sensor": np.array([f"finger-{number}" for number in range(SENSORS)]),
    "joint": np.array([f"joint-{number}" for number in range(16)]),
}


class Given(ObjectStage):
    """Stage that writes the rows of a function."""

    settings_type = Settings
    summary = "in closed form"

    def __init__(
        self, output: Artifact, function: Callable[[Unit], Row], reads: tuple[Artifact, ...], constants: Row, attributes: dict[str, Any]
    ):
        self.name, self.output = f"give-{output.name}", output
        self.row, self._reads, self._constants, self._attributes = function, reads, constants, attributes

    def inputs(self, settings: Settings) -> tuple[Artifact, ...]:
        return self._reads

    def cost(self, settings: Settings) -> Cost:
        return Cost(0.0, 0.0)

    def process(self, unit: Unit, inputs: Inputs, settings: Settings) -> Row:
        return self.row(unit)

    def constants(self, settings: Settings) -> Row:
        return self._constants

    def attributes(self, settings: Settings) -> dict[str, Any]:
        return self._attributes


def stages() -> list[Given]:
    sensors = {"sensors": [SENSOR.model_dump(mode="json")] * SENSORS}
    return [
        Given(SURFACES, surfaces, (), {}, {}),
        Given(GRASPS, grasps, (SURFACES,), LABELS, {"settings": HAND}),
        Given(
            VISION,
            vision,
            (GRASPS,),
            {"camera": np.array(["front"])},
            {"settings": HAND, "scene": load_scene("supplement").model_dump(mode="json")},
        ),
        Given(TOUCH, touch, (SURFACES, GRASPS), {"untouched": np.stack([untouched_image(SENSOR)] * SENSORS)}, sensors),
        Given(DISTANCES, distances, (SURFACES,), {}, {}),
        Given(CHARTS, charts, (TOUCH,), {"chart_faces": chart_square(SIDE)[1].numpy().astype(np.int32)}, {}),
    ]


def objects(count: int, splits: Sequence[str] = ("test",)) -> list[Object]:
    """Balls named a, b, …, bottles and knives in turn, in these splits in turn."""
    turns = [(("bottle", "knife")[number % 2], splits[number % len(splits)]) for number in range(count)]
    return [
        Object(chr(ord("a") + number), kind, {"kind": "procedural", "category": "bottle", "number": number}, split)
        for number, (kind, split) in enumerate(turns)
    ]


@cache
def _made(count: int, splits: tuple[str, ...], ungrasped: str, shards: int, _: Callable[..., np.ndarray]) -> Path:
    """Make a dataset in a folder that lasts as long as this process; another one if a test replaces `touched`, the last parameter."""
    folder = Path(tempfile.mkdtemp(prefix="balls-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    for stage in stages():
        request: Any = Request(stage, Settings(), "balls", objects(count, splits), "draft", 0, folder, shards=shards)
        pack(request, stage.row, ungrasped if stage.output is GRASPS else "")
    return folder


def make_data(data: Path, count: int, splits: Sequence[str] = ("test",), ungrasped: str = "", shards: int = 1) -> None:
    """Write every artifact of a number of balls; the rows are made here, which spares the start of five worker processes.

    The balls `ungrasped` fail in simulate-grasps.
    """
    shutil.copytree(_made(count, tuple(splits), ungrasped, shards, touched), data, dirs_exist_ok=True)


def run_stage(data: Path, name: str, items: list[Object], *assignments: str, seed: int = 0, folder: str | None = None) -> None:
    """Run a stage on a dataset of balls."""
    settings = resolve(name, "draft", assignments)
    (plan,) = plans(Request(load_stage(name), settings, "balls", items, "draft", seed, data, folder=folder))
    plan.make(Console(quiet=True))


def make_model(data: Path, name: str, *, still: bool = False, training_seed: int = 0) -> Path:
    """Save a small network of a configuration, as `train-gcn` does, with random weights or (`still`) one that leaves the sphere."""
    sizes = {"gcn_layers": 3, "gcn_features": 12, "encoder_width": 0.125, "side": SIDE, "splits": 0}
    config = CONFIGURATIONS[name].model_copy(update=sizes)
    network = DeformationNetwork(config, torch.Generator().manual_seed(len(name) + training_seed))
    if still:
        with torch.no_grad():
            for parameter in network.parameters():
                parameter.zero_()
    return _save(data, name, network, training_seed)


def make_implicit_model(data: Path, name: str, diagonals: tuple[float, float] | None = None, **sizes: Any) -> Path:
    """Save a small implicit network, as `train-implicit` does, with random weights; much is inside, but where touches say otherwise.

    It says that it has learned from objects of `diagonals`, m, by default 0.5.
    """
    small = {"features": 16, "blocks": 1, "spacing": 0.03, "side": SIDE, "encoder_width": 0.125}
    network = ImplicitNetwork(IMPLICIT_CONFIGURATIONS[name].model_copy(update=small | sizes), torch.Generator().manual_seed(3))
    with torch.no_grad():
        network.last.bias -= 1.0
    return _save(data, name, network, diagonals=diagonals)


def _save(data: Path, name: str, network: Any, training_seed: int = 0, diagonals: tuple[float, float] | None = None) -> Path:
    """Save a network with its description, and publish it with facts of a training that was none."""
    config = network.config
    folder = data / ".work" / "made" / f"{name} {training_seed}"
    folder.mkdir(parents=True)
    camera = projection_matrix(CAMERA).tolist() if config.image else None
    resolution = [CAMERA.resolution] * 2 if config.image else None
    charts = {"side": config.side} if config.takes_charts else None
    views: Any = {"camera": camera, "resolution": resolution}
    save_model(folder, network, Trained(configuration=name, network=config, charts=charts, diagonals=diagonals, **views))
    hardware = {"device": "test CPU", "processes": 1, "threads": 1, "precision": "32-true"}
    facts = {
        "parameters": 1000,
        "items": 2,
        "epochs": 3,
        "best_epoch": 1,
        "best": {"loss": 2.5},
        "training_seconds": 1.5,
        "hardware": hardware,
    }
    return publish(
        data, model_name(name, training_seed), folder, "train-implicit" if name in IMPLICIT_CONFIGURATIONS else "train-gcn", facts
    )
