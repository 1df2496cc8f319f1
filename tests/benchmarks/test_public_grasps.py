"""The comparison with DexGraspBench: what is prepared of a clone, and figures of known verdicts."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmarks.grasp_tests import GRASP_TESTS
from benchmarks.public_grasps import ENGINES, GraspSet, prepare, table
from benchmarks.timing import write_sections

MJCF = """<mujoco><compiler meshdir="../../../third_party/mujoco_menagerie/shadow_hand/assets"/>
<worldbody><body><joint name="one"/><geom size=".01"/><body><joint name="two"/><geom size=".01"/></body></body></worldbody></mujoco>"""


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    public = tmp_path / "clone"
    for folder in ("assets/hand/shadow", "third_party/mujoco_menagerie/shadow_hand/assets", ".git"):
        (public / folder).mkdir(parents=True)
    (public / "assets/hand/shadow/right_hand.xml").write_text(MJCF)
    for scale in ("006", "012"):
        (public / f"output/example_shadow/graspdata/core_jar_1/scale{scale}_pose000").mkdir(parents=True)
    return public


def test_clone_is_copied_with_its_scenes_as_objects(clone: Path, tmp_path: Path) -> None:
    bench = tmp_path / "bench"
    assert prepare(clone, bench) == ["one", "two"]
    assert (bench / "catalogue.csv").read_text().splitlines()[1:] == [
        "core_jar_1-scale006_pose000,jar,assets/example_object/core_jar_1/mesh/simplified.obj,y,0.06",
        "core_jar_1-scale012_pose000,jar,assets/example_object/core_jar_1/mesh/simplified.obj,y,0.12",
    ]
    assert yaml.safe_load((bench / "objects.yaml").read_text())["splits"]["test"] == 2
    assert not (bench / ".git").exists()


def grasps(own: list[list[bool]], ours: list[bool]) -> GraspSet:
    judged = [[{"succ_flag": flag, "ho_pene": 0.0, "contact_num": 4} for flag in flags] for flags in own]
    held = {(test, engine): (np.array(ours), 1.5) for test in GRASP_TESTS for engine in ENGINES}
    return GraspSet(judged, held, np.array([0.0, 0.001, 0.002, 0.003]))


def test_verdicts_are_compared_for_the_grasps_that_both_tests_took() -> None:
    result = table({"some": grasps([[True, True, False], [False, True, False]], [True, True])})
    cells = {name: cell for name, cell in result.rows}
    assert cells["grasps in its own test, in ours"] == "6, 2"
    assert cells["held in its own test, %"] == "50"
    assert cells["of the first and the last of each object"] == "50, 0"
    assert cells["same verdict in both, %"] == "50"  # of [True, False] and [True, True]
    assert cells["at most 1 mm inside, %"] == "50"
    assert cells["processor seconds to make a grasp"] == "–"


def test_sections_of_a_page_are_replaced_in_their_order_and_others_added(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Title\n\nAbout.\n\n## One\n\nold\n\n## Two\n\nkept\n")
    write_sections(page, ["## Three\n\nadded\n", "## One\n\nnew\n"])
    assert page.read_text() == "# Title\n\nAbout.\n\n## One\n\nnew\n\n## Two\n\nkept\n\n## Three\n\nadded\n"
