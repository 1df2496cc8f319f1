"""The tactile simulator as a library: sensors, touches and grasps of a mesh, without the pipeline; and reconstructions.

>>> import vt_pipeline as vt
>>> sensor = vt.load_sensor("gelsight_mini")
>>> mug = vt.load_object("mug.glb")
>>> touch = vt.touch(mug, sensor, pose)  # touch.depth, .image, .points, .normals, .contact_area, .gel
>>> touch = vt.press(relief, sensor, depth=0.5e-3)  # (rows, cols) heights, m; vt.image(touch.depth, sensor) is touch.image
"""

from pathlib import Path

from vt_pipeline.shadowing import refuse_shadows

refuse_shadows(Path(__file__).parents[1])

from pipeline.errors import InvalidInput  # noqa: E402
from pipeline.formats.sensor_file import load_sensor  # noqa: E402
from pipeline.kernels.touch.sensor import Sensor  # noqa: E402
from pipeline.reconstruct.observation_file import RobotObservation  # noqa: E402
from vt_pipeline.grasping import Grasps, grasp  # noqa: E402
from vt_pipeline.objects import TouchObject, load_object  # noqa: E402
from vt_pipeline.pressing import image, press, untouched_image  # noqa: E402
from vt_pipeline.reconstructing import load_observation, reconstruct  # noqa: E402
from vt_pipeline.touching import Touch, Touches, touch, touch_many  # noqa: E402

__all__ = [
    "Grasps",
    "InvalidInput",
    "RobotObservation",
    "Sensor",
    "Touch",
    "TouchObject",
    "Touches",
    "grasp",
    "image",
    "load_object",
    "load_observation",
    "load_sensor",
    "press",
    "reconstruct",
    "touch",
    "touch_many",
    "untouched_image",
]
