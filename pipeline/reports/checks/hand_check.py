"""The check of a hand file: what moves, what is in the way, and a picture of the hand from three sides."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.console import counted
from pipeline.formats.hand_file import load_hand
from pipeline.formats.physics_urdf import links_without_mass
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.kernels.hand.collision_shapes import collision_boxes
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.self_collision import LinkOverlap, fingers_clear_of_palm, frequent_overlaps
from pipeline.reports.hand_picture import closing_directions, hand_picture
from pipeline.rng import numpy_rng
from stages.simulate_grasps.size_warnings import opening, sensor_places

POSTURES = 512
"""Random postures in which links are looked at."""

LEAST_WAY = 1e-3
"""m along its normal that a sensor should go as its finger closes."""

FAR = 2.0
"""A palm is far if no sensor comes nearer to its centre than this many times the greatest distance between two sensors."""


def check(path: Path, picture: Path) -> list[str]:
    """Say what a hand file describes and which links collide, and draw it; parameters, result and errors as `check_file`."""
    hand = load_hand(path)
    sensors = load_worn_sensors(sensor_names(hand))
    angles = numpy_rng(0, "check", hand.name).uniform(hand.lower, hand.upper, (POSTURES, len(hand.lower)))
    frames, boxes = forward_kinematics(hand, np.eye(4), angles), collision_boxes(hand)
    overlaps = frequent_overlaps(hand, boxes, frames)
    hand_picture(hand, [sensor.width for sensor in sensors], [(one.first, one.second) for one in overlaps], picture)
    free = fingers_clear_of_palm(hand, boxes, frames, 0.0).mean(axis=0)
    fingers = ", ".join(
        f"{finger.name} ({counted(len(finger.joints), 'joint')}, {counted(len(finger.sensors), 'sensor')})" for finger in hand.fingers
    )
    faults = _faults(hand, free)
    return [
        f"{path}: hand {hand.name}, {len(hand.links)} links, {'faults below' if faults else 'no faults'}",
        f"moves: {fingers}; joints that follow another: {len(hand.followers)}, frozen: {len(hand.frozen)}",
        f"motors {hand.torque:g} N m (N), friction {hand.friction:g}, opens {1e3 * opening(hand):.0f} mm",
        *faults,
        *(_overlap(hand, one) for one in overlaps),
        *_notes(hand),
        f"picture: {picture}",
    ]


def _faults(hand: Hand, free: np.ndarray) -> list[str]:
    """What keeps the hand from grasping."""
    stuck = [
        f"fault: {finger.name} is free of the palm and its own links in no posture; see the overlaps below"
        for finger, share in zip(hand.fingers, free, strict=True)
        if share == 0
    ]
    bare = [
        f"fault: no link of {finger.name} has a collision shape"
        for finger in hand.fingers
        if not any(hand.links[link].collisions for link in finger.links)
    ]
    rest = np.clip(0.0, hand.lower, hand.upper)
    way = closing_directions(hand, rest)
    on_fingers = {sensor for finger in hand.fingers for sensor in finger.sensors}
    still = [
        f"fault: the sensor {mount.name} hardly moves along its normal as its finger closes; is the normal outward, and the link the tip?"
        for number, mount in enumerate(hand.sensors)
        if number in on_fingers and np.linalg.norm(way[number]) < LEAST_WAY
    ]
    return [*stuck, *bare, *still, *_far_palm(hand)]


def _far_palm(hand: Hand) -> list[str]:
    """Tell a palm that is not where the fingers are, as the base of an arm."""
    places = sensor_places(hand)
    away = np.linalg.norm(places - hand.palm_centre, axis=-1).min()
    apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1).max()
    if len(hand.sensors) < 2 or away <= FAR * apart:
        return []
    return [
        f"fault: no sensor comes nearer to the palm's centre than {1e3 * away:.0f} mm, and sensors are at most {1e3 * apart:.0f} mm apart; "
        f"is palm.link, {hand.links[0].name}, the link that the fingers grow from, and palm.centre in its frame?"
    ]


def _overlap(hand: Hand, one: LinkOverlap) -> str:
    names = f"{hand.links[one.first].name}, {hand.links[one.second].name}"
    return (
        f"overlap: [{names}] in {100 * one.share:.0f} % of random postures, by {1e3 * one.depth:.1f} mm: list the pair under "
        "allowed_contacts, or split a mesh with convex_parts"
    )


def _notes(hand: Hand) -> list[str]:
    notes = []
    if massless := links_without_mass(hand):
        notes.append(f"mass estimated from collision shapes at 1000 kg/m³: {', '.join(massless)}")
    if hand.allowed_contacts:
        pairs = sorted(f"[{hand.links[first].name}, {hand.links[second].name}]" for first, second in hand.allowed_contacts)
        notes.append(f"let overlap, as stated or as neighbours that do at rest: {', '.join(pairs)}")
    return notes
