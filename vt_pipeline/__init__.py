"""The pipeline as a library: sensors, touches and grasps of a mesh; datasets, and reconstructions.

>>> import vt_pipeline as vt
>>> sensor = vt.load_sensor("gelsight_mini")
>>> mug = vt.load_object("mug.glb")
>>> touch = vt.touch(mug, sensor, pose)  # touch.depth, .image, .points, .normals, .contact_area, .gel
>>> touch = vt.press(relief, sensor, depth=0.5e-3)  # (rows, cols) heights, m; vt.image(touch.depth, sensor) is touch.image
>>> for touch in vt.slide(mug, sensor, poses, friction=0.6):  # a path: touch.traction, .displacement, .slip, .shear_force, .torque too
...     image = vt.markers(touch, dots).image  # (N, 2) positions, m
>>> vt.make("dataset", "data/mugs", "my-meshes")  # grasps, images and touches of a folder of meshes
>>> touches = vt.Dataset("data/mugs", ["depth", "tactile_image"])  # a PyTorch dataset, one grasp after the other
"""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

OURS = ("pipeline", "stages", "schemas")


def refuse_shadows(root: Path) -> None:
    """Raise an `ImportError` that names the package and its place, where one of `OURS` is not in the folder `root`."""
    for name in OURS:
        spec = find_spec(name)
        place = Path(spec.origin or next(iter(spec.submodule_search_locations or [""]))) if spec else None
        if place is None or root.resolve() not in place.resolve().parents:
            raise ImportError(
                f"vt_pipeline needs its own package {name!r} in {root}, but Python finds {place or 'none'}: a file or folder of your "
                f"project hides it. Rename that, or start Python from another folder: what is first on sys.path is found"
            )


refuse_shadows(Path(__file__).parents[1])

from pipeline.errors import InvalidInput  # noqa: E402
from pipeline.formats.sensor_file import load_sensor  # noqa: E402
from pipeline.kernels.touch.sensor import Sensor  # noqa: E402
from pipeline.reconstruct.observation_file import RobotObservation  # noqa: E402
from vt_pipeline.grasping import Grasps, grasp  # noqa: E402
from vt_pipeline.making import load_observation, make, reconstruct  # noqa: E402
from vt_pipeline.objects import TouchObject, load_object  # noqa: E402
from vt_pipeline.pressing import image, press, untouched_image  # noqa: E402
from vt_pipeline.sliding import Markers, SlidingTouch, markers, slide  # noqa: E402
from vt_pipeline.touching import Touch, Touches, touch, touch_many  # noqa: E402

__all__ = [
    "Dataset",
    "Grasps",
    "InvalidInput",
    "Markers",
    "RobotObservation",
    "Sensor",
    "SlidingTouch",
    "Touch",
    "TouchObject",
    "Touches",
    "grasp",
    "image",
    "load_object",
    "load_observation",
    "load_sensor",
    "make",
    "markers",
    "press",
    "reconstruct",
    "slide",
    "touch",
    "touch_many",
    "untouched_image",
]


def __getattr__(name: str) -> Any:
    """Import the dataset of grasps when it is asked for: it needs torch, which takes a second."""
    if name == "Dataset":
        from pipeline.dataset.grasp_dataset import GraspDataset

        return GraspDataset
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
