"""The errors of `make tradeoff`, on stores whose errors are known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh

from benchmarks.stored_grasps import Seen
from benchmarks.tradeoff.errors import ERRORS, SOUND, Errors
from benchmarks.tradeoff.runs import Made
from pipeline.config.settings import Settings
from pipeline.engine.plan import Request
from pipeline.engine.unit import Unit
from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.collision_shapes import collision_boxes
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.sensor import pixel_centres
from pipeline.kernels.touch.tactile_image import untouched_image
from pipeline.kernels.vision.camera import projection_matrix
from pipeline.models.touch_model import save_touch_model
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.charts import CHARTS, STOP_RULES
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.evaluate.evaluation_files import Figure, Figures, long_table, write_evaluation
from stages.registry import STAGES
from tests.engine.tiny_stages import pack, publish
from tests.stages import ball_dataset as spheres
from tests.stages.pressed_balls import SENSOR

UM, MM = 1e-6, 1e-3
ATTRIBUTES: dict[str, dict[str, Any]] = {"touch": {"sensors": [SENSOR.model_dump(mode="json")] * 2}}
CONSTANTS: dict[str, Row] = {
    "touch": {"untouched": np.stack([untouched_image(SENSOR)] * 2)},
    "vision": {"camera": np.array(["front"]), "projection": projection_matrix(spheres.CAMERA)[None]},
    "charts": {"chart_faces": np.zeros((1, 3), np.int32)},
}


def store(data: Path, output: Artifact, row: Callable[[Unit], Row], count: int = 2, failed: str = "") -> Path:
    """Write what a function says of each of some objects, a, b, …, but for those that failed."""
    stage: Any = spheres.Given(output, row, (), CONSTANTS.get(output.name, {}), ATTRIBUTES.get(output.name, {}))
    items = spheres.objects(count)
    pack(Request(stage=stage, settings=Settings(), objects=items, manifest="known", preset="draft", seed=0, data=data), row, failed)
    return data


def number(unit: Unit) -> int:
    return ord(unit.name) - ord("a")


def errors(stage: str, made: Path, reference: Path = Path()) -> Errors:
    return ERRORS[stage](Made(made, 0.0, 0.0, {}), reference)


def sure(found: Errors, *figures: float, each: list[float], power: int = 1, rel: float = 1e-3) -> None:
    """Check the figures, in this order, each object's value of the first, and the power at which they are averaged."""
    assert list(found.figures.values()) == pytest.approx(list(figures), rel=rel)
    assert list(found.each) == pytest.approx(each, rel=rel)
    assert found.power == power


def test_errors_are_of_stages_in_their_order() -> None:
    assert list(ERRORS) == [name for name in STAGES if name in ERRORS]


def lifted(unit: Unit, near: float, far: float) -> Row:
    """Move a ball's points outwards, along their directions: most by `near` m, one in ten by `far`."""
    row = spheres.surfaces(unit)
    off = np.where(np.arange(len(row["points"])) % 10, near, far)[:, None]
    return row | {"points": (row["points"] + off * row["normals"]).astype(np.float32)}


def test_a_surface_that_points_stand_off_by_so_much_is_missed_by_so_much(tmp_path: Path) -> None:
    made = store(tmp_path / "made", SURFACES, spheres.surfaces)
    dense = store(tmp_path / "dense", SURFACES, lambda unit: lifted(unit, (1 + number(unit)) * MM, 20 * MM))
    squares = [0.9 * 1 + 0.1 * 400, 0.9 * 4 + 0.1 * 400]
    sure(errors("sample-surfaces", made, dense), np.sqrt(np.mean(squares)), 10, each=list(np.sqrt(squares)), power=2)


def held(unit: Unit, touched: list[list[int]], attempts: float = 0.75) -> Row:
    """Hands of an object at the origin, and which of their sensors touch."""
    success = np.array(touched, bool)
    return spheres.grasps(unit) | {
        "hand_pose": np.tile(np.eye(4), (len(success), 1, 1)),
        "joint_angles": np.zeros((len(success), 16)),
        "sensor_pose": np.tile(np.eye(4), (*success.shape, 1, 1)),
        "touch_success": success,
        "penetration": np.zeros(len(success), np.float32),
        "attempt_success": np.full(success.shape[1], attempts, np.float32),
    }


TOUCHED = {"a": [[1, 1, 1, 1], [1, 1, 0, 0]], "b": [[1, 1, 1, 0], [1, 1, 1, 1]]}


def test_touches_are_missing_where_there_is_none_or_it_changes_or_the_hand_is_inside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = {
        "a": [seen("a", 0, SOUND, [0, 0, 0, 1]), seen("a", 1, 0, [1, 0, 1, 0])],  # 3 + 1 of 8 are sound
        "b": [seen("b", 0, 0, [0, 0, 0, 0]), seen("b", 1, 1.01 * SOUND, [0, 0, 0, 0])],  # 3 + 0
    }
    monkeypatch.setattr("benchmarks.tradeoff.errors.examine", lambda data, points: found if data == tmp_path else None)
    made = store(tmp_path, GRASPS, lambda unit: held(unit, TOUCHED[unit.name], 0.5 + 0.25 * number(unit)))
    one = errors("simulate-grasps", made)
    sure(one, 100 * (4 / 8 + 5 / 8) / 2, 100 * (1 - 0.625), 100 * 3 / 16, 1.01, each=[50, 62.5])
    assert one.touches == 16


def seen(name: str, grasp: int, depth: float, changed: list[int]) -> Seen:
    return Seen(depth, 0.0, np.array(TOUCHED[name][grasp], bool), np.array(changed, bool), True)


def test_hands_that_stand_in_a_block_and_touch_nothing_are_measured_so(tmp_path: Path) -> None:
    hand = load_hand("allegro_right")
    boxes = collision_boxes(hand)
    frames = forward_kinematics(hand, np.eye(4), np.zeros(16))[boxes.link] @ boxes.frames
    lowest = (frames[:, 2, 3] - (np.abs(frames[:, 2, :3]) * boxes.half).sum(axis=1)).min()
    block = trimesh.creation.box((1, 1, 1)).apply_translation([0, 0, lowest + 2 * MM - 0.5])
    mesh = {"meshes/vertices": block.vertices, "meshes/faces": block.faces.astype(np.int32), "meshes/uv": np.zeros((8, 2))}
    look = {"meshes/face_material": np.zeros(12, np.int32)}
    store(tmp_path, SURFACES, lambda unit: spheres.surfaces(unit) | mesh | look)
    store(tmp_path, GRASPS, lambda unit: held(unit, TOUCHED["a"]))
    sure(errors("simulate-grasps", tmp_path), 100, 25, 75, 2, each=[100, 100], rel=0.02)


def test_an_object_without_grasps_has_all_its_touches_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = {"a": [seen("a", 0, 0, [0, 0, 0, 0]), seen("a", 1, 0, [0, 0, 0, 0])]}
    monkeypatch.setattr("benchmarks.tradeoff.errors.examine", lambda *_: found)
    made = store(tmp_path, GRASPS, lambda unit: held(unit, TOUCHED["a"], 1.0), failed="b")
    sure(errors("simulate-grasps", made), (25 + 100) / 2, 50, 0, 0, each=[25, 100])


def image(level: int, size: int, columns: slice) -> Row:
    """Make a grey image with an object in half of its rows and these columns, a hand beside it; a grasp's view shows only the object."""
    segmentation = np.zeros((2, size, size), np.uint8)
    segmentation[0, size // 4 : 3 * size // 4, columns] = 1
    segmentation[0, 0] = 2
    segmentation[1] = 1
    return {"unoccluded": np.full((1, size, size, 3), level, np.uint8), "segmentation": segmentation[:, None]}


def test_images_differ_by_their_levels_and_silhouettes_by_their_columns(tmp_path: Path) -> None:
    made = store(tmp_path / "made", VISION, lambda unit: image(100 + 3 + number(unit), 16, slice(4, 14 - 2 * number(unit))))
    true = store(tmp_path / "true", VISION, lambda unit: image(100, 32, slice(8, 24)))
    levels, c1 = np.array([103, 104]) / 255, 0.01**2
    likeness = (2 * levels * 100 / 255 + c1) / (levels**2 + (100 / 255) ** 2 + c1)
    sure(errors("render-vision", made, true), np.sqrt((9 + 16) / 2), 100 * 4 / 16 / 2, 1 - likeness.mean(), each=[3, 4], power=2, rel=1e-9)


def felt(off: float = 0.0, beyond: float = 0.0, outlier: float = 0.0, lost: int = 0, invented: int = 0, changed: int = 0) -> Row:
    """Depths of a step in the gel, of its very top, and beyond it, moved by a distance; some pixels have other hits and images."""
    depth = np.full((3, 2, *SENSOR.shape), np.inf)
    depth[..., :10, :] = 3 * MM + off / 2
    depth[..., 10:15, :] = SENSOR.w - 0.5 * UM + off
    depth[..., 15:19, :] = 20 * MM + beyond
    depth[0, 0, 0, 0] = 3 * MM + outlier
    depth[0, 0, 18, :lost] = np.inf
    depth[0, 0, 19, :invented] = 30 * MM
    tactile_images = np.zeros((*depth.shape, 3), np.uint8)
    tactile_images.reshape(-1, 3)[:changed, 1] = 1
    return {"depth": depth.astype(np.float32), "tactile_image": tactile_images}


def test_depths_are_off_by_what_they_were_moved_by_in_the_gel_and_beyond(tmp_path: Path) -> None:
    made = store(tmp_path / "made", TOUCH, lambda unit: felt((1 + 2 * number(unit)) * UM, 2 * UM, 50 * UM, 3, 2, 30 * number(unit)))
    true = store(tmp_path / "true", TOUCH, lambda _: felt())
    sure(errors("simulate-touch", made, true), 3, 50, 2, 2 * (3 + 2), 100 * 30 / 2400 / 2, each=[1, 3], rel=2e-3)


PREDICTED = 3 * MM


def pressed(unit: Unit) -> Row:
    """Make touches of a flat object 0.1 mm nearer than predicted, in images one column wider; all but the first object touch once."""
    depth = np.full((1, 2, *SENSOR.shape), 10 * MM, np.float32)
    depth[..., 5:15, 5:15] = PREDICTED - 0.1 * MM * (1 + number(unit))
    if number(unit):
        depth[0, 1] = 1 * MM
    tactile_images = np.tile(untouched_image(SENSOR), (1, 2, 1, 1, 1))
    tactile_images[..., 5:15, 5:16, :] ^= 128
    return {"depth": depth, "tactile_image": tactile_images}


def test_a_network_that_says_one_depth_is_off_by_the_true_ones(tmp_path: Path) -> None:
    store(tmp_path, TOUCH, pressed, 3, failed="c")
    store(tmp_path, GRASPS, lambda unit: held(unit, [[1, number(unit) == 0]]), 3)
    network = UNet(1)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.zero_()
        network.head.load_state_dict({"weight": network.head.weight, "bias": torch.tensor([np.log(PREDICTED / (SENSOR.w - PREDICTED))])})
    (folder := tmp_path / "made").mkdir()
    save_touch_model(folder, network, sensor=SENSOR, untouched=untouched_image(SENSOR), mask_threshold=1e-3)
    publish(tmp_path, "models/unet", folder, "train-unet")
    pitch = float(np.diff(pixel_centres(SENSOR)[0])[0]) / UM
    apart = np.sqrt(np.array([100, 100, 200]) ** 2 + pitch**2 / 11 / 2)
    sure(errors("train-unet", tmp_path), np.sqrt((2 * 100**2 + 200**2) / 3), apart.mean(), each=[100, 200], power=2)


def fitted(unit: Unit) -> Row:
    """Charts with a given error, µm, of which one object's last was stopped by the cap; others were not fitted, of one object none."""
    last, off = {"a": ("threshold", [100, 300]), "b": ("cap", [200, 300]), "c": ("no_touch", [0, 0])}[unit.name]
    rules = ["no_touch" if unit.name == "c" else "threshold", last, "no_touch", "too_few_points", "collapsed"]
    return {
        "vertices": np.zeros((1, 5, 9, 3), np.float32),
        "residual": np.array([[*off, 0, 0, 0]], np.float32) * np.float32(UM),
        "iterations": np.zeros((1, 5), np.int32),
        "stop_rule": np.array([[STOP_RULES.index(rule) for rule in rules]], np.uint8),
    }


def test_charts_are_as_far_off_as_those_that_were_fitted(tmp_path: Path) -> None:
    made = store(tmp_path, CHARTS, fitted, 4, failed="d")
    sure(errors("fit-charts", made), (100 + 300 + 200 + 300) / 4, 300, 25, each=[200, 250])


def evaluated(data: Path, chamfer: dict[str, list[list[list[float]]]]) -> None:
    """Write an evaluation of models by name with these Chamfer distances (object, first grasp, grasps given)."""
    ids = [f"object-{row}" for row in range(len(next(iter(chamfer.values()))))]
    figures = {
        name: Figures(
            ids,
            [
                Figure(object_id, first, 1 + given, "chamfer", value)
                for object_id, firsts in zip(ids, distances, strict=True)
                for first, values in enumerate(firsts)
                for given, value in enumerate(values)
            ],
        )
        for name, distances in chamfer.items()
    }
    objects = {"object_id": ids, "category": ["x"] * len(ids), "area": np.ones(len(ids)), "floor": np.ones(len(ids))}
    (folder := data / "made").mkdir(parents=True)
    settings = {"points": 1, "scale": 1.0}
    felt = {"settings": settings, "seed": 0, "split": "test", "left_out": {}, "configurations": {name: {"touch": True} for name in chamfer}}
    write_evaluation(folder, {"figures": long_table(figures), "objects": objects}, felt)
    publish(data, "evaluation", folder, "evaluate")


def test_a_network_s_error_is_the_mean_of_its_evaluation(tmp_path: Path) -> None:
    touch = [[[4e-4, 2e-4], [8e-4, 2e-4]], [[2e-4, 1e-4], [2e-4, 1e-4]]]
    evaluated(tmp_path, {"touch": touch, "occluded-touch": np.ones((2, 2, 2)).tolist()})
    found = errors("train-gcn", tmp_path)
    mean, one, low, high = found.figures.values()
    assert [mean, one] == pytest.approx([9000 * 2.75e-4, 9000 * 4e-4])
    assert low < mean < high
    assert found.each == pytest.approx([9000 * 4e-4, 9000 * 1.5e-4])


def test_of_a_single_test_object_there_is_no_interval(tmp_path: Path) -> None:
    evaluated(tmp_path, {"touch": [[[4e-4, 2e-4]]]})
    found = errors("train-gcn", tmp_path)
    assert found.figures == pytest.approx({"Chamfer x 9000": 2.7, "with one grasp": 3.6})


def test_an_evaluation_is_off_by_what_its_table_is(tmp_path: Path) -> None:
    true = [[[1e-4, 1e-4]], [[3e-4, 1e-4]]]
    made = [[[1.4e-4, 0.8e-4]], [[3e-4, 1e-4]]]  # over objects 2.2e-4 for 2e-4, and 0.9e-4 for 1e-4
    for name, values in (("made", made), ("true", true)):
        evaluated(tmp_path / name, {"touch": values})
    sure(errors("evaluate", tmp_path / "made", tmp_path / "true"), 100 * (0.1 + 0.1) / 2, each=[100 * 0.1 / 1.5, 0], rel=1e-12)


KNOWN: dict[str, tuple[Artifact, Callable[[Unit], Row], Callable[[Unit], Row], float]] = {
    "sample-surfaces": (SURFACES, spheres.surfaces, lambda unit: lifted(unit, MM, MM), 1),
    "render-vision": (VISION, lambda _: image(103, 16, slice(4, 12)), lambda _: image(100, 16, slice(4, 12)), 3),
    "simulate-touch": (TOUCH, lambda _: felt(3 * UM), lambda _: felt(), 3),
}


@pytest.mark.parametrize("stage", KNOWN)
def test_objects_that_failed_on_either_side_are_left_out(tmp_path: Path, stage: str) -> None:
    artifact, row, true_row, error = KNOWN[stage]
    made, true = store(tmp_path / "made", artifact, row, 3, "a"), store(tmp_path / "true", artifact, true_row, 3, "b")
    found = errors(stage, made, true)
    assert [found.error, *found.each] == pytest.approx([error, error], rel=2e-3)


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("trained", [False, True])
def test_bound_holds_for_nineteen_other_datasets_in_twenty(power, trained, rng: np.random.Generator) -> None:
    """Objects differ, and so do trainings: ten objects, four trainings."""

    def dataset(trainings: int) -> tuple[np.ndarray, np.ndarray]:
        each = rng.gamma(9.0, 1.0, 10)
        luck = 1 + 0.15 * rng.normal(size=trainings) * trained
        return each * luck[0], np.mean(each**power) ** (1 / power) * luck

    kept = 0
    for _ in range(1000):
        each, trainings = dataset(4)
        bound = Errors({"error": trainings[0]}, list(each), power).bound(list(trainings) if trained else [])
        kept += dataset(1)[1][0] <= bound
    assert 0.9 <= kept / 1000 <= 0.985  # squares of few objects are skew


def test_bound_of_no_missing_touch_follows_the_rule_of_three():
    assert Errors({"missing, %": 0.0}, [0.0] * 10, touches=200).bound([]) == 1.5
    assert Errors({"missing, %": 60.0}, [0.0, 100.0, 100.0], touches=60).bound([]) == 100
