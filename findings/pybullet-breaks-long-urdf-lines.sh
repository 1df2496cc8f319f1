#!/bin/sh
# PyBullet cuts numbers of a URDF short where a line of the file reaches its 8192nd character.
#
# One expects: where lines of an XML file end makes no difference; the writers of Python's xml.etree and of many robot exporters write one line.
# What happens: loadURDF reads lines into a buffer of 8192 characters and puts a line break wherever the buffer ends. In the middle of a number the
#     rest is dropped without a word: a joint's origin of 0.1234567 m becomes 0.123 m, 0.12 m or 0 m, a mass of 1.2345678 kg becomes 1.2 kg.
#     The same file with a line per element is read as it is written.
# Whom it hurts: a robot hand in one line has 20,000 to 60,000 characters, so that it is cut at two to seven places. Where one lies in a number, a
#     finger is moved by up to centimetres or a link is lighter, and another simulator that reads the same file disagrees.
# Versions: pybullet 3.2.7, numpy 2.4.6, Python 3.11. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pybullet==3.2.7 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import pathlib
from xml.etree import ElementTree

import pybullet

pybullet.connect(pybullet.DIRECT)


def finger(comment):
    """Make a base and one link, after a comment that moves them along the line."""
    robot = ElementTree.Element("robot", name="finger")
    robot.append(ElementTree.Comment(comment))
    for name in ("base", "tip"):
        inertial = ElementTree.SubElement(ElementTree.SubElement(robot, "link", name=name), "inertial")
        ElementTree.SubElement(inertial, "mass", value="1.2345678")
        ElementTree.SubElement(inertial, "inertia", ixx="1", iyy="1", izz="1", ixy="0", ixz="0", iyz="0")
    joint = ElementTree.SubElement(robot, "joint", name="bend", type="revolute")
    ElementTree.SubElement(joint, "parent", link="base")
    ElementTree.SubElement(joint, "child", link="tip")
    ElementTree.SubElement(joint, "origin", xyz="0 0 0.1234567")
    ElementTree.SubElement(joint, "axis", xyz="0 0 1")
    ElementTree.SubElement(joint, "limit", lower="0", upper="1", effort="1", velocity="1")
    return robot


def load(robot, name):
    """Load a robot and return the joint's z in the parent's frame and the tip's mass; file names differ, as PyBullet keeps files that it has read."""
    path = pathlib.Path(f"{name}.urdf")
    ElementTree.ElementTree(robot).write(path)
    body = pybullet.loadURDF(str(path), flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
    return pybullet.getJointInfo(body, 0)[14][2], pybullet.getDynamicsInfo(body, 0)[0]


surprises = 0
for value, which in (("0.1234567", 0), ("1.2345678", 1)):
    at = ElementTree.tostring(finger("")).decode().rindex(value)
    for kept in (5, 4, 2):
        robot = finger("x" * (8191 - kept - at))
        broken = load(robot, f"line-{which}-{kept}")[which]
        ElementTree.indent(robot)
        whole = load(robot, f"lines-{which}-{kept}")[which]
        print(f"{value} with {kept} characters before the limit: {broken:.7g} from one line, {whole:.7g} from a line per element")
        surprises += abs(broken - float(value[:kept])) < 1e-9 and abs(whole - float(value)) < 1e-9
raise SystemExit(surprises != 6)
END
