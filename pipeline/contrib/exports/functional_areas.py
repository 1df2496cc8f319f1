"""Where Open-X-Tactile has the sensors and joints of any hand: areas of a human hand, and slots of a vector of 32 joints."""

from collections.abc import Sequence

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand

DIGITS = (("thumb",), ("index",), ("middle",), ("ring",), ("little", "pink"))
"""Names of fingers; fingers with other names, as of grippers, are counted from the thumb."""
PALM = 5
SLOTS = 32
GRIPPER = 28  # slot of a hand with a single joint
THUMB = (1, 0, 26, 3, 4)  # slots of a thumb of five joints, the Shadow Hand's
PARALLEL = np.cos(np.pi / 4)  # cosine from which on two directions count as parallel


def tactile_areas(hand: Hand) -> list[int]:  # (S,)
    """Find the area of each sensor: fingertips 0 to 4, thumb first; palm 5; the links before the tips 6 to 10, those before 11 to 14."""
    keys = []
    for mount, finger in zip(hand.sensors, hand.sensor_fingers, strict=True):
        name = hand.fingers[finger].name if finger >= 0 else "palm"
        keys.append(mount.name if "+" in name or (finger >= 0 and _digit(mount.name) is not None) else name)
    digits = _digits([key for key in keys if key != "palm"], hand) | {"palm": PALM}
    areas = []
    for mount, key in zip(hand.sensors, keys, strict=True):
        digit = digits[key]
        links = {other.link for other, same in zip(hand.sensors, keys, strict=True) if digits[same] == digit}
        before = sum(link > mount.link for link in links)  # links with sensors between this one and the tip: parents come before children
        areas.append(digit if not before or digit == PALM else 6 + digit if before == 1 or not digit else 10 + digit)
    return areas


def joint_slots(hand: Hand) -> list[int]:  # (J,)
    """Find the slot of each entry of the joint vector.

    A finger has five: of a twist about itself, of a spread across the palm, and of three bends from base to tip. The thumb's are 1 for the
    first joint, 0 for a twist, and three more. A joint whose slot is taken gets the next free one.
    """
    if len(hand.joint_names) == 1:
        return [GRIPPER]
    if len(hand.joint_names) > SLOTS:
        raise InvalidInput(f"Open-X-Tactile has {SLOTS} joints of a hand, {hand.name} has {len(hand.joint_names)}; use --to lerobot")
    poses = forward_kinematics(hand, np.eye(4), np.zeros(len(hand.joint_names)))
    digits = _digits([finger.name for finger in hand.fingers], hand)
    slots: dict[int, int] = {}
    for finger in hand.fingers:
        first, bends = 5 * digits[finger.name], 0
        for number, entry in enumerate(finger.joints):
            link = hand.joint_links[entry]
            axis, ahead = poses[link, :3, :3] @ hand.joints[link - 1].axis, poses[finger.links[-1], :3, 3] - poses[link, :3, 3]
            if first == 0 and (number == 0 or len(finger.joints) == len(THUMB)):
                wanted = THUMB[number]
            elif abs(axis @ ahead) > PARALLEL * np.linalg.norm(ahead):
                wanted = first
            elif first and abs(axis @ hand.palm_facing) > PARALLEL:
                wanted = first + 1
            else:
                wanted, bends = first + 2 + bends, min(bends + 1, 2)
            slots[entry] = next(slot for slot in (wanted, *range(first, first + 5), *range(SLOTS)) if slot not in slots.values())
    return [slots[entry] for entry in range(len(hand.joint_names))]


def _digit(name: str) -> int | None:
    """Find the finger that a name names."""
    return next((number for number, words in enumerate(DIGITS) if any(word in name.lower() for word in words)), None)


def _digits(names: Sequence[str], hand: Hand) -> dict[str, int]:
    """Assign numbers to fingers by their names, and the free ones to others in order."""
    digits = {name: digit for name in names if (digit := _digit(name)) is not None}
    others = [name for name in dict.fromkeys(names) if name not in digits]
    free = [number for number in range(len(DIGITS)) if number not in digits.values()]
    if len(others) > len(free):
        raise InvalidInput(f"Open-X-Tactile has five fingers, {hand.name} has {len(set(names))}; use --to lerobot")
    return digits | dict(zip(others, free, strict=False))
