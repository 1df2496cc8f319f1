"""URDF files in any encoding are read; other formats in place of a URDF are named."""

import re
from pathlib import Path

import pytest

from pipeline.errors import InvalidInput
from pipeline.formats.urdf import read_urdf
from pipeline.formats.urdf_xml import parse_urdf

ROBOT = '<robot name="r"><link name="{}"/></robot>'


def declared(encoding: str, name: str = "palm") -> str:
    return f'<?xml version="1.0" encoding="{encoding}"?>\n' + ROBOT.format(name)


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (declared("gb2312", "左手").encode("gb2312"), "左手"),
        (declared("Big5", "手掌").encode("big5"), "手掌"),
        (declared("Shift_JIS", "指先").encode("shift_jis"), "指先"),
        (declared("windows-1252", "Müller").encode("windows-1252"), "Müller"),
        (declared("UTF-16", "dłoń").encode("utf-16"), "dłoń"),
        (declared("UTF-16", "dłoń").encode("utf-16-be"), "dłoń"),  # without a mark
        (ROBOT.format("dłoń").encode("utf-16"), "dłoń"),
        (declared("UTF-8", "dłoń").encode("utf-8-sig"), "dłoń"),
        (ROBOT.format("dłoń").encode(), "dłoń"),
        (declared("latin-1", "dłoń").encode("utf-8-sig"), "dłoń"),  # the mark counts
    ],
)
def test_encoding_is_that_of_the_mark_or_the_declaration(tmp_path: Path, content: bytes, name: str) -> None:
    (path := tmp_path / "hand.urdf").write_bytes(content)
    assert [link.get("name") for link in parse_urdf(path)] == [name]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (declared("UTF-8").replace("palm", "m\xfcller").encode("latin-1"), "it is not in UTF-8, as it says ("),
        (ROBOT.format("müller").encode("latin-1"), "it is not in UTF-8, and names no other encoding ("),
        (declared("klingon").encode(), "its encoding, klingon, is unknown; save it as UTF-8"),
        (declared("UTF-16BE").encode() + b" ", "save it as UTF-8"),
        (b"", "it is not XML (no element found: line 1, column 0); a hand's `urdf` must be a URDF file"),
        (b"#usda 1.0\n", "it is not XML (syntax error"),
        (b'<mujoco><include file="a.xml"/></mujoco>', "it is MJCF, MuJoCo's format; a hand's `urdf` must be a URDF file"),
        (b'<sdf version="1.7"><world name="w"/></sdf>', "it is SDF, Gazebo's format"),
        (b'<?xml version="1.0"?><model><sdf>model.sdf</sdf></model>', "it is the model.config of an SDF model"),
        (b"<!DOCTYPE html>\n<html><body/></html>", "it is a web page: download the file itself"),
        (b"<scene/>", "it is a file whose root is <scene>; a hand's `urdf` must be a URDF file, whose root is <robot>"),
        (
            b'<robot name="r"><link name="${side}_palm"/></robot>',
            'it is xacro, from which a URDF is made: it has <link name="${side}_palm">; run xacro first, `xacro IN > OUT.urdf`',
        ),
        (b'<robot name="$(arg name)"/>', 'it has <robot name="$(arg name)">; run xacro first'),
        (b'<robot name="r"><xacro:include filename="palm.xacro"/></robot>', "it has <xacro:include>; run xacro first"),
    ],
)
def test_what_is_no_urdf_is_named_with_the_remedy(tmp_path: Path, content: bytes, message: str) -> None:
    (path := tmp_path / "hand.urdf").write_bytes(content)
    with pytest.raises(InvalidInput, match=rf"hand\.urdf: .*{re.escape(message)}"):
        parse_urdf(path)


def test_urdf_that_xacro_wrote_may_declare_its_prefix(tmp_path: Path) -> None:
    text = ROBOT.format("palm").replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
    (path := tmp_path / "hand.urdf").write_text(text)
    assert len(parse_urdf(path)) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('<robot name="r"/>', "there is no link 'palm'; there are none at all"),
        (
            '<robot name="r"><link name="palm"/><link name="b"/>'
            '<joint name="j" type="fixed"><parent link="palm"/><child link="b"/></joint>'
            '<joint name="k" type="fixed"><parent link="b"/><child link="palm"/></joint></robot>',
            "2 links with 2 joints are not a tree with one root (roots: none)",
        ),
    ],
)
def test_empty_lists_are_written_as_none(tmp_path: Path, text: str, message: str) -> None:
    (path := tmp_path / "hand.urdf").write_text(text)
    with pytest.raises(InvalidInput, match=re.escape(message)):
        read_urdf(path, "palm")
