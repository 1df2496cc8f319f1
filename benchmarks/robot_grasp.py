"""Write a simulated grasp as a robot would have recorded it: `examples/robot_grasp/`.

    python -m benchmarks.robot_grasp DATA OBJECT GRASP FOLDER

The frame is that of a robot's base beside the object: turned and moved against the simulation's world. The camera's axes are OpenCV's.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import binary_dilation
from scipy.spatial.transform import Rotation

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import ObjectRows
from pipeline.formats.description_file import shipped_files
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh_cleaning import POSITION
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.vision.scene import Label
from pipeline.kernels.vision.view_transfer import optical_centre, split_projection
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location, as_location
from schemas.surfaces import SURFACES

ARRAYS = ("sensor", "occluded", "segmentation", "projection", "tactile_image", "untouched", "sensor_pose", "touch_success")
BASE = np.array([[-0.5, -(0.75**0.5), 0, 0.62], [0.75**0.5, -0.5, 0, -0.17], [0, 0, 1, -0.35], [0, 0, 0, 1]])
"""From the world to the robot's base: a third of a turn about the vertical, and a motion."""
HEAD = """\
# {what}: `vt-pipeline check {name}`, then
# vt-pipeline predict out.glb --observation {name} --surface closed
unit: m                            # of all lengths below
                                   # frame of all poses: the robot's base, +z up
"""
OBJECT = """\
object:
  centre: {centre}     # middle of its box; docs/guide/own-photographs.md says which
  diagonal: {diagonal}                   # of that box

"""
CAMERA = """\
camera:
  image: seen.png                  # rectified
  mask: mask.png                   # white where the image shows the object
  hand_mask: hand.png              # white where it shows the hand
  depth: depth.png                 # along the viewing direction, registered to the photograph; 0 where nothing was measured
  depth_scale: 0.001               # m per level
  intrinsics: {{fx: {fx}, fy: {fy}, cx: {cx}, cy: {cy}}}   # OpenCV's cx and cy plus 0.5
  convention: opencv               # the camera looks along +z, +y is down
  pose:                            # camera to base, from hand-eye calibration
    position: {position}
    quaternion: {quaternion}   # x, y, z, w
"""
RGBD = """\
  depth_as_touch: true             # the visible points are given as touched ones are; where the object is, the depth says
"""
TOUCHES = """\

sensor: {sensor}
untouched: untouched.png
touches:                           # pose: forward kinematics of the fingertip, times the mounting of its sensor
"""


def main() -> None:
    """Write the files of a grasp."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=as_location)
    parser.add_argument("object")
    parser.add_argument("grasp", type=int)
    parser.add_argument("folder", type=Path)
    arguments = parser.parse_args()
    write_grasp(arguments.data, arguments.object, arguments.grasp, arguments.folder)


def write_grasp(data: Location, object_id: str, grasp: int, folder: Path) -> Path:
    """Write images of a stored grasp, `rgbd.yaml`, which has no touches, and `grasp.yaml`; return the path of the latter."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = ObjectRows(data, ARRAYS, None)
    photograph, labels = rows.read("occluded", object_id, grasp, camera=0), rows.read("segmentation", object_id, camera=0)[1 + grasp]
    background = np.median(photograph[labels == Label.BACKGROUND], axis=0)
    drawn = (photograph != background).any(axis=2)  # at smooth edges, beyond the labels too
    hand = drawn & (labels != Label.OBJECT) & binary_dilation(labels == Label.HAND)
    _save(folder / "seen.png", photograph)
    _save(folder / "hand.png", 255 * hand.astype(np.uint8))
    _save(folder / "mask.png", 255 * (drawn & ~hand).astype(np.uint8))
    matrix = rows.read("projection", object_id, camera=0)[1 + grasp]
    depth = np.where(labels == Label.HAND, 0, _object_depth(data, object_id, matrix, labels.shape))
    _save(folder / "depth.png", np.rint(1e3 * depth).astype(np.uint16))
    untouched = rows.read("untouched", object_id)[0]
    _save(folder / "untouched.png", untouched)
    intrinsic, rotation = split_projection(matrix)
    camera = np.eye(4)
    camera[:3, :3], camera[:3, 3] = rotation.T, optical_centre(matrix)
    position, quaternion = _moved(camera)
    k = {"fx": intrinsic[0, 0], "fy": intrinsic[1, 1], "cx": intrinsic[0, 2], "cy": intrinsic[1, 2]}
    facts = {
        "centre": _listed((BASE @ [*POSITION, 1.0])[:3], 4),
        "diagonal": f"{rows.diagonal(object_id):.7g}",
        **{name: f"{value:.6g}" for name, value in k.items()},
        **{"position": position, "quaternion": quaternion, "sensor": _sensor_name(rows.sensor(), untouched, folder)},
    }
    (folder / "rgbd.yaml").write_text((HEAD + CAMERA + RGBD).format(what="What an RGB-D camera saw", name="rgbd.yaml", **facts))
    text = (HEAD + OBJECT + CAMERA + TOUCHES).format(what="A grasp as a robot recorded it", name="grasp.yaml", **facts)
    arrays = (rows.read(name, object_id, grasp) for name in ("tactile_image", "sensor_pose", "touch_success"))
    for name, image, pose, touched in zip(rows.read("sensor", object_id).tolist(), *arrays, strict=True):
        _save(folder / f"{name}.png", image)
        position, quaternion = _moved(pose)
        text += f"  - name: {name}\n    tactile_image: {name}.png\n    touched: {str(bool(touched)).lower()}\n"
        text += f"    pose: {{position: {position}, quaternion: {quaternion}}}\n"
    (folder / "grasp.yaml").write_text(text)
    return folder / "grasp.yaml"


def _sensor_name(sensor: Sensor, untouched: NDArray[np.uint8], folder: Path) -> str:
    """Name the sensor that took the images: a shipped one, or the file `sensor.yaml` that is written, with the photograph it names."""
    if sensor.name in shipped_files("sensor") and load_sensor(sensor.name).model_copy(update={"photograph": None}) == sensor:
        return sensor.name
    (folder / "sensor.yaml").write_text(yaml.safe_dump(sensor.model_dump(mode="json", exclude_none=True)), encoding="utf-8")
    if sensor.calibrated and isinstance(sensor.calibrated.background, str):
        _save(folder / sensor.calibrated.background, untouched)
    return "sensor.yaml"


def _object_depth(data: Location, object_id: str, projection: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Compute the depth of an object alone, m, as a camera sees it: (rows, cols), 0 beside it."""
    mesh = read_mesh(DataDirectory(data).collection(SURFACES).view(object_id))
    intrinsic, rotation = split_projection(projection)
    col, row = np.meshgrid(np.arange(shape[1]) + 0.5, np.arange(shape[0]) + 0.5)
    ahead = np.linalg.solve(intrinsic, np.stack([col.ravel(), row.ravel(), np.ones(col.size)])).T  # one metre along the view
    rays, eye = ahead @ rotation, optical_centre(projection)
    solid: Any = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    places, ray, _ = solid.ray.intersects_location(np.tile(eye, (len(rays), 1)), rays, multiple_hits=False)
    depth = np.zeros(col.size)
    depth[ray] = (places - eye) @ rotation[2]
    return depth.reshape(shape)


def _moved(pose: NDArray[np.float64]) -> tuple[str, str]:
    """Write a pose of the world as position and quaternion in the robot's base."""
    moved = BASE @ pose
    return _listed(moved[:3, 3], 7), _listed(Rotation.from_matrix(moved[:3, :3]).as_quat(), 8)


def _listed(values: NDArray[np.float64], digits: int) -> str:
    return "[" + ", ".join(f"{value:.{digits}f}" for value in values + 0.0) + "]"


def _save(path: Path, image: NDArray[Any]) -> None:
    Image.fromarray(image).save(path, optimize=True)


if __name__ == "__main__":
    main()
