"""The grasps of a dataset: written to a row of `grasps` and read from it, and the hand and sensors that made them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import expanded
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.kernels.hand.grasp import Contact, Grasp
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor
from pipeline.store.directory import Collection
from pipeline.store.rows import Row

ATTRIBUTES = ("hand_pose", "pregrasp_angles", "joint_angles", "squeeze_angles", "sensor_pose")  # of a grasp: arrays of the same name
CONTACT = ("contact_point", "contact_normal", "contact_area")


def grasp_row(grasps: Sequence[Grasp]) -> Row:
    """Make the part of an object's row of `grasps` that describes its grasps: `read_grasps` reads it back."""
    return {
        **{name: np.stack([getattr(grasp, name) for grasp in grasps]) for name in ATTRIBUTES},
        "touch_success": np.stack([grasp.touched for grasp in grasps]),
        "contact_point": np.array([[contact.point if contact else np.zeros(3) for contact in grasp.contacts] for grasp in grasps]),
        "contact_normal": np.array([[contact.normal if contact else np.zeros(3) for contact in grasp.contacts] for grasp in grasps]),
        "contact_area": np.stack([grasp.contact_area for grasp in grasps]).astype(np.float32),
        "opposition": np.array([grasp.opposition for grasp in grasps], np.float32),
    }


def grasp_count(row: Mapping[str, np.ndarray]) -> int:
    """Count the grasps of an object's row, without those that `read-grasps` repeated at the end."""
    return len(str(row["grasp_files"]).splitlines()) if "grasp_files" in set(row) else len(row["touch_success"])


def grasp_counts(grasps: Collection, object_ids: Sequence[str]) -> dict[str, int]:
    """Count the grasps of objects, as `grasp_count`."""
    if not grasps.first.has("grasp_files"):
        return dict.fromkeys(object_ids, grasps.first.stored("touch_success").shape[1])
    return {name: grasp_count(grasps.view(name)) for name in object_ids}


def read_grasps(row: Mapping[str, np.ndarray]) -> list[Grasp]:
    """Read an object's grasps from its row, without repeated ones; how deep the gels were pressed in is not stored."""
    contacts = [
        [Contact(point, normal, float(area)) if touches else None for touches, point, normal, area in zip(*of_grasp, strict=True)]
        for of_grasp in zip(row["touch_success"], *(row[name] for name in CONTACT), strict=True)
    ]
    return [Grasp(*grasp) for grasp in zip(*(row[name] for name in ATTRIBUTES), contacts, strict=True)][: grasp_count(row)]


def grasping_hand(
    attributes: Mapping[str, Mapping[str, Any]],  # of the roots of `grasps` and, where images were rendered, of `vision`
) -> Hand:
    """Load the hand that made a dataset's grasps.

    Its file may have been moved since: `render-vision` took its new path as a setting, and drew only this hand.
    """
    name = attributes.get("vision", attributes["grasps"])["settings"]["hand"]
    check_hand_exists(name, "put it there, or run render-vision again with its path")
    return load_hand(name)


def check_hand_exists(name: str, remedy: str) -> None:
    """Raise an `InvalidInput` with a remedy if the hand's file that a dataset records is missing."""
    path = expanded(name)
    if path.suffix in (".yaml", ".yml") and not path.is_file():
        where = "" if path.is_absolute() else ", a path from the folder where it was made: run this there, or"
        raise InvalidInput(f"the dataset records the hand {name!r}{where or ', which is not there:'} {remedy}")


def grasping_sensors(attributes: Mapping[str, Mapping[str, Any]]) -> tuple[Sensor, ...]:
    """Load the sensors of that hand; `attributes` as for `grasping_hand`."""
    return load_worn_sensors(sensor_names(grasping_hand(attributes), attributes["grasps"]["settings"].get("sensor")))
