"""Describe a hand for MuJoCo: links and gels, motors, couplings, and which links may overlap."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import SubElement, parse

from pipeline.formats.mjcf_files import import_mujoco
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.depth_maps import gel_top
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.hand_urdf import ARMATURE, gel_name, write_hand_urdf

HARD = {"solref": [0.005, 1.0], "solimp": [0.5, 0.99, 0.0001, 0.5, 2.0]}  # contacts and gears as stiff as DexGraspBench makes them
MOTORS = {"revolute": 5.0, "continuous": 5.0, "prismatic": 1e3}  # N m/rad, those of DexGraspBench, and N/m: 20 N at 2 cm


def urdf_spec(
    hand: Hand,
    sensors: Sequence[Sensor],  # of its mounts, each a plate that slides along its normal; or none
    folder: Path,  # that the URDF and meshes are written to; MuJoCo reads meshes when the description is compiled
) -> Any:
    """Make MuJoCo's description of a hand, an `MjSpec`, of the URDF that we write; without motors."""
    urdf = write_hand_urdf(hand, folder, sensors)
    tree = parse(urdf)
    options = {"strippath": "true", "fusestatic": "false", "balanceinertia": "true", "discardvisual": "true"}
    SubElement(SubElement(tree.getroot(), "mujoco"), "compiler", options)
    tree.write(urdf)
    return import_mujoco().MjSpec.from_file(str(urdf))


def add_drives(
    spec: Any,
    hand: Hand,
    gain: Mapping[str, float],  # N m/rad and N/m of a joint's motor, by kind
) -> None:
    """Add a motor for each entry of the joint vector, in that order, the gears of following joints, and which links may overlap."""
    mujoco = import_mujoco()
    joined = {(joint.parent, joint.child) for joint in hand.joints}  # MuJoCo lets links of a palm that does not move collide with it
    bodies = {number: name for number, link in enumerate(hand.links) if spec.body(name := link.name)}
    body_of = {number: min(body for body in bodies if body >= number) for number in range(len(hand.links))}  # links of one body follow
    for first, second in sorted({(body_of[first], body_of[second]) for first, second in joined | hand.allowed_contacts}):
        if first != second:
            spec.add_exclude(bodyname1=bodies[first], bodyname2=bodies[second])
    for name, link in zip(hand.joint_names, hand.joint_links, strict=True):
        kind = hand.joints[link - 1].kind
        spec.joint(name).armature = ARMATURE[kind]
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, forcerange=[-hand.torque, hand.torque])
        motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE  # set_to_position() writes MJCF that MuJoCo 3.3, which DexGraspBench needs, refuses
        motor.gainprm[0], motor.biasprm[:3] = gain[kind], [0, -gain[kind], 1]  # critically damped
    for follower in hand.followers:
        gear = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, **HARD)
        gear.name1, gear.name2 = hand.joints[follower.link - 1].name, hand.joint_names[follower.entry]
        gear.data[:2] = follower.offset, follower.multiplier


def write_hand_mjcf(hand: Hand, sensors: Sequence[Sensor], path: Path) -> list[str]:
    """Write a hand as MJCF, its meshes beside it, with gels as rigid plates; return the names of its joints in the order of `qpos`.

    Its world frame is that of the root link.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    spec = urdf_spec(hand, sensors, path.parent)
    add_drives(spec, hand, MOTORS)
    for number, sensor in enumerate(sensors):
        plate = spec.body(gel_name(number))
        for joint in plate.joints:
            spec.delete(joint)
        plate.pos = hand.sensors[number].pose[:3, :3] @ [0, 0, gel_top(sensor)] + hand.sensors[number].pose[:3, 3]
    model = spec.compile()
    path.write_text(spec.to_xml(), encoding="utf-8")
    (path.parent / "hand.urdf").unlink()
    return [model.joint(number).name for number in range(model.njnt)]
