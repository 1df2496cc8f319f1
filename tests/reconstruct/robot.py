"""A small robot that sees and touches a ball: observations in closed form, as entries of a file."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS
from pipeline.kernels.touch.tactile_image import untouched_image
from pipeline.kernels.vision.camera import Camera, projection_matrix
from pipeline.reconstruct.object_location import Target
from pipeline.reconstruct.observation_entries import Pose

CENTRE, RADIUS = np.array([0.4, -0.1, 0.2]), 0.06
EYE = CENTRE + np.array([-0.5, 0.0, 0.0])
FOCAL, COLS, ROWS = 300.0, 160, 120
SENSOR = load_sensor("gel_16mm")
CAMERA_AXES = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""Columns: right is -y, down is -z, forward is +x, OpenCV's convention."""
TRAINING = projection_matrix(
    Camera(name="camera", position=(1.1, 0.3, 0.9), rotation=(75, 0, 105), focal=(200, 200), centre=(64, 64), resolution=128)
)


def camera_pose() -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = CAMERA_AXES, EYE
    return pose


def touch_pose(direction: tuple[float, float, float]) -> np.ndarray:
    """Place a sensor in a direction from the ball's centre, facing it, pressed in by a millimetre."""
    outward = np.array(direction) / np.linalg.norm(direction)
    across = np.cross(outward, np.eye(3)[np.argmin(np.abs(outward))])
    across /= np.linalg.norm(across)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([across, np.cross(-outward, across), -outward], axis=1)
    pose[:3, 3] = CENTRE + outward * (RADIUS + SENSOR.w - 1e-3)
    return pose


def ball_depth() -> np.ndarray:
    """Compute the exact depth of the ball along the viewing direction, m; NaN beside it."""
    x, y = np.meshgrid((np.arange(COLS) + 0.5 - COLS / 2) / FOCAL, (np.arange(ROWS) + 0.5 - ROWS / 2) / FOCAL)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    squared, along, away = (rays**2).sum(axis=-1), 0.5, 0.5**2 - RADIUS**2  # |t rays - (0, 0, 0.5)| = RADIUS
    with np.errstate(invalid="ignore"):
        return (along - np.sqrt(along**2 - squared * away)) / squared


def write_files(folder: Path) -> dict[str, Any]:
    """Write photographs, masks and depths; return the entries of a valid observation file."""
    depth = ball_depth()
    seen = ~np.isnan(depth)
    photograph = np.where(seen[..., None], np.array([200, 60, 40], np.uint8), np.array([230, 232, 235], np.uint8))
    Image.fromarray(photograph).save(folder / "seen.png")
    Image.fromarray(255 * seen.astype(np.uint8)).save(folder / "mask.png")
    Image.fromarray(np.where(seen, np.rint(1e4 * np.nan_to_num(depth)), 0).astype(np.uint16)).save(folder / "depth.png")
    np.save(folder / "depth.npy", depth.astype(np.float32))
    for name in ("index", "thumb"):
        Image.fromarray(untouched_image(SENSOR)).save(folder / f"{name}.png")
    return {
        "object": {"centre": CENTRE.tolist(), "diagonal": 2 * RADIUS * 3**0.5},
        "camera": {
            "image": "seen.png",
            "mask": "mask.png",
            "intrinsics": {"fx": FOCAL, "fy": FOCAL, "cx": COLS / 2, "cy": ROWS / 2},
            "pose": camera_pose().tolist(),
        },
        "sensor": "gel_16mm",
        "touches": [
            {"tactile_image": f"{name}.png", "pose": touch_pose(direction).tolist()}
            for name, direction in (("index", (0, 1, 0)), ("thumb", (0, -1, 0)))
        ],
    }


def scaled_pose(pose: Pose, scale: float) -> np.ndarray:
    """Write a pose in a unit that makes lengths larger by a factor."""
    scaled = pose.array.copy()
    scaled[:3, 3] *= scale
    return scaled


def target(name: str = "occluded-touch", diagonals: tuple[float, float] | None = None, **changes: object) -> Target:
    config = CONFIGURATIONS[name].model_copy(update=changes)
    image = config.image is not None
    return Target(
        configuration=name,
        network=config,
        camera=TRAINING.tolist() if image else None,
        resolution=(128, 128) if image else None,
        background=(230, 232, 235) if image else None,
        charts={} if config.touch else None,
        diagonals=diagonals,
        sensor=SENSOR if config.touch else None,
    )


class _Plain(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


def write_observation(folder: Path, entries: dict[str, Any]) -> Path:
    (folder / "grasp.yaml").write_text(yaml.dump(entries, Dumper=_Plain))
    return folder / "grasp.yaml"
