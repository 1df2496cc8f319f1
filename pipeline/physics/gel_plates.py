"""Gels in physics: plates on springs, which slide along the sensor's normal from its plane to the gel's surface."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import SubElement, parse

import numpy as np

from pipeline.formats.physics_urdf import add_origin
from pipeline.kernels.hand.grasp_closure import Contact
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.depth_maps import gel_top
from pipeline.kernels.touch.sensor import Sensor

GEL_MODULUS = 1e5
"""Pa, Young's modulus of a gel whose sensor file gives none: soft silicone. Pressed in by 2 mm over 60 mm², a gel of 7 mm presses back
with 2 N."""
GEL_MASS = 0.02
"""kg, of a gel's plate: a lighter one swings on its spring faster than steps of 1/240 s can follow."""
DAMPING = 0.25
"""Damping of that spring, as a share of the critical damping."""

OVERLAP = 1e-4
"""m by which a plate starts in the object: engines find no contact between two flat faces that only meet, and the spring would drive one
into the other by 3 mm in its first step."""


@dataclass(frozen=True)
class GelSpring:
    """The spring of a gel's plate in a contact.

    Attributes
    ----------
    height
        Of the plate above the sensor plane where it meets the object, m.
    stiffness, damping
        N/m and N s/m.
    torsion
        Moment about the normal that friction resists per newton of normal force, m.
    """

    height: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    torsion: float = 0.0


def gel_spring(sensor: Sensor, contact: Contact | None, *, friction: float, margin: float = 0.0) -> GelSpring:
    """Compute the spring of a gel in a contact; one that does not touch is drawn in and has none.

    Parameters
    ----------
    sensor, contact
        A sensor and its contact, None where it does not touch.
    friction
        Coefficient between gel and object.
    margin
        m around the object at which the engine's contact begins.

    Notes
    -----
    In the contact it presses as an elastic layer does (Winkler's foundation: pressure = modulus * indentation / thickness). Where the
    plate's distance from there to the gel's surface is below `OVERLAP` it presses less: its stiffness would have no bound.
    Friction about the normal is that of a disc of the contact's area under constant pressure, 2/3 μ times its radius.
    """
    if contact is None:
        return GelSpring()
    top = gel_top(sensor)
    height = min(max(contact.nearest - margin + OVERLAP, 0.0), top)
    modulus = GEL_MODULUS if sensor.gel is None else sensor.gel.modulus
    stiffness = modulus / sensor.layer_thickness * contact.volume / max(top - height, OVERLAP)
    torsion = 2 / 3 * friction * float(np.sqrt(contact.area / np.pi))
    return GelSpring(height, stiffness, 2 * DAMPING * float(np.sqrt(stiffness * GEL_MASS)), torsion)


def gel_name(number: int) -> str:
    """Name the link of a sensor's plate, and the joint that moves it."""
    return f"gel of sensor {number}"


def add_gel_plates(urdf: Path, hand: Hand, sensors: Sequence[Sensor]) -> None:
    """Add a plate per sensor to a hand's URDF file."""
    tree = parse(urdf)
    for number, (mount, sensor) in enumerate(zip(hand.sensors, sensors, strict=True)):
        link = SubElement(tree.getroot(), "link", name=gel_name(number))
        inertial = SubElement(link, "inertial")
        SubElement(inertial, "mass", value=str(GEL_MASS))
        SubElement(inertial, "inertia", ixx="1e-6", iyy="1e-6", izz="1e-6", ixy="0", ixz="0", iyz="0")
        plate = SubElement(link, "collision")
        SubElement(plate, "origin", xyz=f"0 0 {-sensor.w / 2}")
        SubElement(SubElement(plate, "geometry"), "box", size=f"{sensor.width} {sensor.height} {sensor.w}")
        joint = SubElement(tree.getroot(), "joint", name=gel_name(number), type="prismatic")
        SubElement(joint, "parent", link=hand.links[mount.link].name)
        SubElement(joint, "child", link=gel_name(number))
        add_origin(joint, mount.pose)
        SubElement(joint, "axis", xyz="0 0 1")
        SubElement(joint, "limit", lower="0", upper=str(gel_top(sensor)), effort="1000", velocity="10")
    tree.write(urdf)
