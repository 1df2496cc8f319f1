"""Describe a hand for MuJoCo: links and gels, motors, couplings, and which links may overlap."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import SubElement, parse

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.depth_maps import gel_top
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.hand_urdf import gel_name, write_hand_urdf

ARMATURE = {"revolute": 1e-3, "continuous": 1e-3, "prismatic": 0.3}
"""kg m² and kg of a motor's rotor, reflected to its joint; without it, a light fingertip swings faster than the steps can follow."""
HARD = {"solref": [0.005, 1.0], "solimp": [0.5, 0.99, 0.0001, 0.5, 2.0]}
"""Contacts and gears as stiff as DexGraspBench makes them."""
MOTORS = {"revolute": 5.0, "continuous": 5.0, "prismatic": 1e3}
"""N m/rad, those of DexGraspBench, and N/m: 20 N at 2 cm."""


def hand_spec(
    hand: Hand,
    folder: Path,  # where its URDF and its meshes are written, which MuJoCo reads when the description is compiled
    sensors: Sequence[Sensor] = (),  # of its mounts, each a plate that slides along its normal
    gain: Mapping[str, float] = MOTORS,  # N m/rad and N/m of a joint's motor, by kind
) -> Any:
    """Make MuJoCo's description of a hand, an `MjSpec`, with a motor for each entry of the joint vector, in that order."""
    mujoco, urdf = import_mujoco(), write_hand_urdf(hand, folder, sensors)
    tree = parse(urdf)
    options = {"strippath": "true", "fusestatic": "false", "balanceinertia": "true", "discardvisual": "true"}
    SubElement(SubElement(tree.getroot(), "mujoco"), "compiler", options)
    tree.write(urdf)
    spec = mujoco.MjSpec.from_file(str(urdf))
    joined = {(joint.parent, joint.child) for joint in hand.joints}  # MuJoCo lets links of a palm that does not move collide with it
    for first, second in sorted(joined | hand.allowed_contacts):
        spec.add_exclude(bodyname1=hand.links[first].name, bodyname2=hand.links[second].name)
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
    return spec


def write_hand_mjcf(hand: Hand, sensors: Sequence[Sensor], path: Path) -> list[str]:
    """Write a hand as MJCF, its meshes beside it, with gels as rigid plates; return the names of its joints in the order of `qpos`.

    Its world frame is that of the root link.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    spec = hand_spec(hand, path.parent, sensors)
    for number, sensor in enumerate(sensors):
        plate = spec.body(gel_name(number))
        for joint in plate.joints:
            spec.delete(joint)
        plate.pos = hand.sensors[number].pose[:3, :3] @ [0, 0, gel_top(sensor)] + hand.sensors[number].pose[:3, 3]
    model = spec.compile()
    path.write_text(spec.to_xml(), encoding="utf-8")
    (path.parent / "hand.urdf").unlink()
    return [model.joint(number).name for number in range(model.njnt)]


def joint_values(
    hand: Hand,
    names: Sequence[str],  # of N joints that move
    joint_vector: Array,  # (J,) rad (m)
) -> list[float]:  # (N,) rad (m)
    """Compute the values of joints in a posture, those that follow others too."""
    values = dict(zip(hand.joint_names, joint_vector.tolist(), strict=True))
    values |= {hand.joints[follower.link - 1].name: float(follower.of(joint_vector)) for follower in hand.followers}
    return [values[name] for name in names]


def import_mujoco() -> Any:
    """Import MuJoCo, without its log file; raise an `InvalidInput` with the command that installs it if it is missing."""
    try:
        import mujoco
    except ModuleNotFoundError as error:
        raise InvalidInput("this needs MuJoCo; `pip install -c constraints.txt -e '.[mujoco]'` installs it (20 MB)") from error
    mujoco.set_mju_user_warning(lambda message: None)  # it would write MUJOCO_LOG.TXT into the working directory
    return mujoco
