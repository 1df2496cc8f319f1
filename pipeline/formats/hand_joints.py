"""Find which joints of a hand move on their own, which follow another one, and which are frozen."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from pipeline.errors import InvalidInput, missing_name
from pipeline.formats.urdf import MOVING
from pipeline.kernels.geometry.transforms import compose
from pipeline.kernels.hand.kinematics import joint_motion
from pipeline.kernels.hand.model import Follower, Joint, Mimic


@dataclass(frozen=True)
class JointRoles:
    """The joints of a hand, frozen ones fixed; those of the joint vector, in its order; the followers; the frozen ones' angles."""

    joints: tuple[Joint, ...]
    independent: tuple[Joint, ...]
    followers: tuple[Follower, ...]
    frozen: Mapping[str, float]


def joint_roles(
    joints: Sequence[Joint],
    used: Sequence[str],  # joints of all fingers, finger by finger; those that mimic another one may be missing
    frozen: Mapping[str, float],  # angles of joints that no finger uses, rad (m)
) -> JointRoles:
    """Find the role of each joint of a model, parents first; each moving one must have one."""
    moving = {joint.name: joint for joint in joints if joint.kind in MOVING}
    for name in (*used, *frozen):
        if name not in moving:
            raise InvalidInput(missing_name("moving joint", name, moving))
    if twice := sorted({name for name in used if used.count(name) > 1 or name in frozen}):
        raise InvalidInput(f"every moving joint must belong to one finger, or be frozen; this is not so for {', '.join(twice)}")
    leaders = {name: _leader(joint, moving, frozen) for name, joint in moving.items() if joint.mimic is not None and name not in frozen}
    angles = dict(frozen) | {
        name: mimic.multiplier * frozen[mimic.joint] + mimic.offset for name, mimic in leaders.items() if mimic.joint in frozen
    }
    if stuck := [name for name in used if name in angles]:
        leader = leaders[stuck[0]].joint
        raise InvalidInput(f"joint {stuck[0]} follows {leader!r}, which is frozen; leave it out of the finger, or do not freeze that one")
    entries = [name for name in used if name not in leaders]
    if idle := [name for name in moving if name not in (*entries, *leaders, *angles)]:
        together = ", ".join(f"{name}: 0" for name in idle)
        raise InvalidInput(f"{', '.join(idle)} belong to no finger; list them under a finger's joints, or freeze them: {{{together}}}")
    if lost := [name for name, mimic in leaders.items() if mimic.joint not in (*entries, *angles)]:
        leader = leaders[lost[0]].joint
        if leader not in moving:
            raise InvalidInput(f"joint {lost[0]} follows {leader!r}, which is no moving joint of the hand; freeze it: {{{lost[0]}: 0}}")
        raise InvalidInput(f"joint {lost[0]} follows {leader!r}, which no finger uses; list that one under a finger, or freeze both")
    for name, angle in frozen.items():
        lower, upper = moving[name].limits
        limited = moving[name].mimic is None or lower < upper  # a follower needs no limits
        if limited and not lower <= angle <= upper:
            raise InvalidInput(f"frozen: {name} is {angle:g}, outside its limits {lower:g} … {upper:g}")
    followers = [(moving[name], mimic) for name, mimic in leaders.items() if name not in angles]
    return JointRoles(
        tuple(_freeze(joint, angles[joint.name]) if joint.name in angles else joint for joint in joints),
        tuple(moving[name] for name in entries),
        tuple(Follower(joint.child, entries.index(mimic.joint), mimic.multiplier, mimic.offset) for joint, mimic in followers),
        angles,
    )


def _leader(joint: Joint, moving: Mapping[str, Joint], frozen: Collection[str]) -> Mimic:
    """Find the joint that a joint follows at the end of a chain of mimics, which a frozen joint ends."""
    mimic, passed = joint.mimic, {joint.name}
    assert mimic is not None
    while (leader := moving.get(mimic.joint)) is not None and leader.mimic is not None and leader.name not in frozen:
        if leader.name in passed:
            raise InvalidInput(f"joint {joint.name} mimics itself; give one of {', '.join(sorted(passed))} its own motor")
        passed.add(leader.name)
        further = leader.mimic
        mimic = Mimic(further.joint, mimic.multiplier * further.multiplier, mimic.multiplier * further.offset + mimic.offset)
    return mimic


def _freeze(joint: Joint, angle: float) -> Joint:
    origin = compose(joint.origin, joint_motion(joint.kind, joint.axis, angle))
    return replace(joint, kind="fixed", origin=origin, mimic=None, rpy=None)


def moved_links(joints: Sequence[Joint], names: Collection[str]) -> list[int]:
    """List the links that these joints move, and their descendants, base to tip."""
    moved: set[int] = set()
    for joint in joints:  # parents first
        if joint.name in names or joint.parent in moved:
            moved.add(joint.child)
    return sorted(moved)
