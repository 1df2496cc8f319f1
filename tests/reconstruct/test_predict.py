import json
import shutil
from pathlib import Path

import igl
import numpy as np
import pytest
import torch
import trimesh
import yaml
from PIL import Image

from benchmarks.robot_grasp import BASE, write_grasp
from pipeline.dataset.grasp_dataset import GraspDataset
from pipeline.dataset.object_rows import ObjectRows
from pipeline.drawing.colors import TOUCH_COLOR, VISION_COLORS
from pipeline.errors import InvalidInput, PipelineError, StageError, StoreError
from pipeline.formats.mesh_reader import load_mesh
from pipeline.kernels.charts.vision_charts import CHART_VERTICES, vision_charts
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.tactile_image import untouched_image
from pipeline.kernels.vision.camera import project_points
from pipeline.models.observation import Observation
from pipeline.models.reconstruction import Reconstruction, join_vision_charts
from pipeline.models.touch_model import save_touch_model
from pipeline.reconstruct.mesh_files import ClosedMesh, write_closed
from pipeline.reconstruct.predict import PredictOptions, StoredGrasps, predict, size_remark
from pipeline.store.directory import DataDirectory
from tests.command_line import vt
from tests.engine.tiny_stages import publish
from tests.stages import ball_dataset as spheres

FELT = 3  # of a grasp's four sensors


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, 1)
    for name in ("none", "touch", "occluded-touch", "unoccluded"):
        spheres.make_model(folder, name, still=name == "none")
    spheres.make_implicit_model(folder, "implicit-any")
    (unet := folder / "made").mkdir()
    with torch.random.fork_rng():
        torch.manual_seed(0)
        save_touch_model(unet, UNet(8), sensor=spheres.SENSOR, untouched=untouched_image(spheres.SENSOR), mask_threshold=1e-3)
    publish(folder, "models/unet", unet, "train-unet")
    return folder


@pytest.fixture(scope="module")
def grasp(data, tmp_path_factory):
    """Write grasp 2 as a robot records it, in the frame of its base."""
    return write_grasp(data, "a", 2, tmp_path_factory.mktemp("files"))


@pytest.fixture(scope="module")
def data_without_charts(data, tmp_path_factory):
    """Copy the data without charts, which are then fitted to the tactile images as for a robot."""
    return shutil.copytree(data, tmp_path_factory.mktemp("bare") / "data", ignore=shutil.ignore_patterns("charts"))


def entries(grasp: Path, **changes: object) -> dict:
    """Read the entries of a file, with absolute names of its images; changes name a path of entries, joined by two underscores."""
    described = yaml.safe_load(grasp.read_text())
    for holder in (described, described["camera"], *described["touches"]):
        holder |= {name: str(grasp.parent / value) for name, value in holder.items() if str(value).endswith(".png")}
    for name, value in changes.items():
        *path, last = name.split("__")
        holder = described
        for step in path:
            holder = holder[step]
        holder[last] = value
    return described


def write(path: Path, described: dict) -> Path:
    path.write_text(json.dumps(described))
    return path


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
def test_stored_grasp_gives_charts_and_a_joined_surface(data, tmp_path, suffix):
    prediction = predict(tmp_path / f"ball{suffix}", StoredGrasps(data, "a", [2]), PredictOptions(data / "models", "occluded-touch"))
    assert [path.name for path in prediction.files] == [f"ball{suffix}", f"ball-joined{suffix}"]
    assert list(prediction.touched) == [True, True, False, True]
    apart, together = (trimesh.load_scene(path, process=False).to_mesh() for path in prediction.files)
    sphere = vision_charts(0)
    assert len(apart.vertices) == 24 * CHART_VERTICES + FELT * spheres.SIDE**2
    assert len(apart.faces) == len(sphere.faces) + FELT * 8
    assert len(together.vertices) == sphere.position.max() + 1 + FELT * spheres.SIDE**2
    upright = apart.vertices[:, [0, 2, 1]] * [1, -1, 1] if suffix == ".glb" else apart.vertices
    np.testing.assert_allclose(np.sort(upright, axis=0), np.sort(prediction.reconstruction.vertices, axis=0), atol=1e-6)
    charts = GraspDataset(data, ["vertices", "stop_rule"], "test")[2]  # are used unchanged
    fitted = charts["vertices"][charts["stop_rule"] > 0].reshape(-1, 3).double().numpy()
    np.testing.assert_allclose(prediction.reconstruction.vertices[prediction.reconstruction.vision :], fitted, atol=1e-7)
    orange = (np.abs(colors_of(apart, suffix) - TOUCH_COLOR[:3]) <= 1).all(axis=1)
    assert orange.sum() == FELT * spheres.SIDE**2
    assert not list(tmp_path.glob("*.tmp"))
    if suffix != ".ply":
        names = [line.split()[1] for line in prediction.files[0].read_text(errors="replace").splitlines() if line.startswith(("o ", "g "))]
        names = names or list(trimesh.load_scene(prediction.files[0], process=False).geometry)
        assert sorted(names) == sorted([*(f"touch_{n:02d}" for n in range(FELT)), *(f"vision_{n:03d}" for n in range(24))])


@pytest.mark.parametrize(
    ("left_out", "inputs"),
    [
        ((), "occluded-touch"),
        (("touches", "sensor", "untouched"), "occluded"),
        (("camera",), "touch"),
        (("hand_mask", "touches", "sensor", "untouched"), "unoccluded"),
    ],
)
def test_implicit_any_uses_the_inputs_that_an_observation_has(data, grasp, tmp_path, left_out, inputs):
    described = entries(grasp)
    described["object"] = {"centre": described["object"]["centre"], "diagonal": 0.2}
    for name in left_out:
        (described["camera"] if name == "hand_mask" else described).pop(name, None)
    file = write(tmp_path / "g.yaml", described)
    predictions = [
        predict(tmp_path / f"{number}.ply", file, PredictOptions(data / "models", name))
        for number, name in enumerate(("implicit-any", f"implicit-any-{inputs}"))
    ]
    np.testing.assert_array_equal(predictions[0].reconstruction.vertices, predictions[1].reconstruction.vertices)
    assert bool(len(predictions[0].touched)) == ("touch" in inputs)
    vt("check", str(file), "--picture", str(tmp_path / "g.png"), "--models", str(data / "models"), "--configuration", "implicit-any")


def test_observation_with_neither_photograph_nor_touch_is_refused(data, grasp, tmp_path):
    described = {"object": entries(grasp)["object"], "touches": []}
    with pytest.raises(InvalidInput, match="model implicit-any needs a photograph or touches"):
        predict(tmp_path / "a.ply", write(tmp_path / "g.yaml", described), PredictOptions(data / "models", "implicit-any"))


def test_joined_surface_is_closed(data, tmp_path):
    reconstruction = predict(
        tmp_path / "ball.ply", StoredGrasps(data, "a"), PredictOptions(data / "models", "none"), "joined"
    ).reconstruction
    surface = trimesh.Trimesh(*join_vision_charts(reconstruction), process=False)
    assert surface.is_watertight
    assert surface.is_winding_consistent
    assert surface.euler_number == 2
    assert surface.volume > 0
    reach = np.linalg.norm(surface.vertices - spheres.CENTRE, axis=1)  # averages of equal vertices
    np.testing.assert_allclose(reach, ObjectRows(data, ["points"], None).diagonal("a") / 2, rtol=1e-6)


def test_slow_prediction_prints_its_steps(data, tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.console.SECONDS_PER_LINE", -1.0)
    assert "predict: 1 of 3 steps" in vt("predict", tmp_path / "ball.ply", "--data", data, "--object", "a", "--configuration", "none")


def test_command_reports_the_inputs_of_the_closed_mesh(data, tmp_path):
    command = ["predict", tmp_path / "ball.ply", "--data", data, "--object", "a", "--resolution", 64, "--surface", "closed"]
    assert "no touch, so that no place of it is certain; no colour" in vt(*command, "--configuration", "none")
    mesh = trimesh.load(tmp_path / "ball.ply", process=False)
    assert (np.asarray(mesh.visual.vertex_colors) == VISION_COLORS[0]).all()
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * (0.1 * np.sqrt(3)) ** 3, rel=0.1)  # the sphere around the ball's box
    assert f"faces, {FELT} touches; no colour" in vt(*command, "--configuration", "touch")


@pytest.mark.parametrize("suffix", [".ply", ".glb"])
def test_closed_mesh_passes_through_the_touches_and_has_the_colours_of_the_image(data, tmp_path, suffix):
    options = PredictOptions(data / "models", "occluded-touch", resolution=64)
    prediction = predict(tmp_path / f"ball{suffix}", StoredGrasps(data, "a", [2]), options, "closed")
    mesh, shape = trimesh.load_scene(prediction.files[0], process=False).to_mesh(), prediction.reconstruction
    assert prediction.files == [tmp_path / f"ball{suffix}"]
    assert mesh.is_watertight
    assert mesh.body_count == 1
    assert mesh.volume > 0
    upright = mesh.vertices[:, [0, 2, 1]] * [1, -1, 1] if suffix == ".glb" else np.asarray(mesh.vertices)
    np.testing.assert_allclose(upright, prediction.closed.vertices, atol=1e-6)
    touch_vertices = shape.vertices[shape.vision :]
    assert len(touch_vertices) == FELT * spheres.SIDE**2
    assert np.sqrt(igl.point_mesh_squared_distance(touch_vertices, upright, np.asarray(mesh.faces))[0]).max() <= 5e-4
    colors, seen, rounded = colors_of(mesh, suffix), prediction.closed.seen, 7 if suffix == ".glb" else 0  # of dark ones, from 8 bits
    assert np.abs(colors[~seen] - VISION_COLORS[0][:3]).max(initial=0) <= 1
    assert np.abs(colors[seen] - prediction.closed.colors[seen].astype(int)).max(initial=0) <= rounded


def in_base(vertices: np.ndarray) -> np.ndarray:
    """Transform points of the world to the robot's base."""
    return vertices @ BASE[:3, :3].T + BASE[:3, 3]


def test_observation_file_gives_the_surface_of_the_stored_grasp_in_its_frame(data, data_without_charts, grasp, tmp_path):
    """The base differs from the world and the camera has OpenCV's convention: the surface is equal to the digits of the file."""
    stored = predict(tmp_path / "a.ply", StoredGrasps(data_without_charts, "a", [2]), PredictOptions(data / "models", "occluded-touch"))
    observed = predict(tmp_path / "b.ply", grasp, PredictOptions(data / "models", "occluded-touch"))
    assert (observed.touched == stored.touched).all()
    np.testing.assert_array_equal(observed.reconstruction.faces, stored.reconstruction.faces)
    np.testing.assert_allclose(observed.reconstruction.vertices, in_base(stored.reconstruction.vertices), atol=1e-6)
    assert any("views differ by 0.0°" in line for line in observed.remarks)
    repeated = predict(tmp_path / "c.ply", grasp, PredictOptions(data / "models", "occluded-touch"))
    assert repeated.files[0].read_bytes() == observed.files[0].read_bytes()


@pytest.fixture(scope="module")
def millimetres(grasp):
    """Write the grasp in millimetres."""
    described = entries(grasp, unit="mm")
    described["object"] = {
        "centre": [1e3 * value for value in described["object"]["centre"]],
        "diagonal": 1e3 * described["object"]["diagonal"],
    }
    for holder in (described["camera"], *described["touches"]):
        holder["pose"]["position"] = [1e3 * value for value in holder["pose"]["position"]]
    return write(grasp.parent / "mm.yaml", described)


@pytest.mark.parametrize("suffix", [".ply", ".glb"])
def test_file_in_millimetres_gives_a_mesh_in_millimetres_and_gltf_in_metres(data, grasp, millimetres, tmp_path, suffix):
    first, second = (
        predict(tmp_path / f"{number}{suffix}", file, PredictOptions(data / "models", "occluded-touch"), "charts")
        for number, file in enumerate((grasp, millimetres))
    )
    np.testing.assert_allclose(second.reconstruction.vertices, 1e3 * first.reconstruction.vertices, atol=1e-3)
    small, large = (trimesh.load_scene(prediction.files[0], process=False).to_mesh().extents for prediction in (first, second))
    np.testing.assert_allclose(large, small if suffix == ".glb" else 1e3 * small, rtol=1e-5)


def test_gltf_is_upright_whatever_axis_of_the_observation_is_up(data, grasp, tmp_path):
    file = write(grasp.parent / "sideways.yaml", entries(grasp, up=[1.0, 0.0, 0.0]))
    observed = predict(tmp_path / "up.glb", file, PredictOptions(data / "models", "occluded-touch"), "charts")
    size = np.ptp(observed.reconstruction.vertices, axis=0)
    extents = trimesh.load_scene(observed.files[0], process=False).to_mesh().extents
    assert extents[1] == pytest.approx(size[0], rel=1e-5)  # glTF's y is up


def test_closed_mesh_of_an_observation_has_the_colours_of_its_image(data, millimetres, tmp_path):
    options = PredictOptions(data / "models", "occluded-touch", resolution=64)
    prediction = predict(tmp_path / "b.ply", millimetres, options, "closed")
    seen = prediction.closed.seen
    assert 0.2 < seen.mean() < 0.6
    world = (prediction.closed.vertices[seen] / 1e3 - BASE[:3, 3]) @ BASE[:3, :3]
    col, row = project_points(ObjectRows(data, ["projection"], None).read("projection", "a")[0, 0], world).astype(int).T
    image = GraspDataset(data, ["occluded"], "test")[2]["occluded"][0].numpy()
    assert (prediction.closed.colors[seen] == image[row, col]).all(axis=1).mean() > 0.95  # except at some pixel borders
    touch_vertices = prediction.reconstruction.vertices[prediction.reconstruction.vision :]
    assert np.sqrt(igl.point_mesh_squared_distance(touch_vertices, prediction.closed.vertices, prediction.closed.faces)[0]).max() <= 0.5


def test_shipped_example_is_reconstructed_by_a_model_of_another_camera(data, tmp_path):
    """Its camera looks down on the object, unlike that of the balls: the view is rotated, with a warning."""
    example = Path(__file__).parents[2] / "examples" / "robot_grasp" / "grasp.yaml"
    prediction = predict(tmp_path / "bottle.ply", example, PredictOptions(data / "models", "occluded-touch"))
    assert prediction.touched.all()
    assert np.linalg.norm(prediction.reconstruction.vertices - [0.62, -0.17, 0.25], axis=1).max() < 0.5
    assert any(
        line.startswith("warning: camera 1.14 m from the object and 19.2° above its horizon; in training") for line in prediction.remarks
    )


def test_depth_of_a_camera_replaces_touches(data, grasp, tmp_path):
    """Without a touch and without a U-Net, the visible side of the ball becomes part of the surface."""
    described = yaml.safe_load((grasp.parent / "rgbd.yaml").read_text())
    described["camera"] |= {name: str(grasp.parent / value) for name, value in described["camera"].items() if str(value).endswith(".png")}
    file = write(tmp_path / "rgbd.yaml", described)
    models = shutil.copytree(data / "models", tmp_path / "models", ignore=shutil.ignore_patterns("unet*"))
    prediction = predict(tmp_path / "ball.ply", file, PredictOptions(models, "touch"))
    assert not len(prediction.touched)
    visible = prediction.reconstruction.vertices[prediction.reconstruction.vision :]
    assert len(visible) > 10 * spheres.SIDE**2
    middle = (BASE @ [*spheres.CENTRE, 1])[:3]
    np.testing.assert_allclose(np.linalg.norm(visible - middle, axis=1), 0.1, atol=2e-3)  # depth is in whole millimetres
    assert any("patches of the visible surface are given as touched" in line for line in prediction.remarks)


def test_touches_without_a_statement_are_recognised_from_images(data, grasp, tmp_path):
    described = entries(grasp)
    stated = [touch.pop("touched") for touch in described["touches"]]
    prediction = predict(tmp_path / "a.ply", write(tmp_path / "g.yaml", described), PredictOptions(data / "models", "touch"))
    assert list(prediction.touched) == stated
    names = ", ".join(touch["name"] for touch, felt in zip(described["touches"], stated, strict=True) if not felt)
    assert f"{names}: no contact is seen, so the network is given a free gel" in prediction.remarks
    described["touches"] = [touch | {"touched": True} for touch in described["touches"]]
    prediction = predict(tmp_path / "a.ply", write(tmp_path / "g.yaml", described), PredictOptions(data / "models", "touch"))
    assert f"warning: {names}: touched: true, but no contact is seen, so no touch is given" in prediction.remarks
    assert "model touch takes no image: the photograph only colours a closed mesh" in prediction.remarks


@pytest.mark.parametrize(("size", "warns"), [(0.5, True), (0.9, False), (1.2, False), (1.5, True)])
def test_surfaces_of_another_size_than_their_objects_are_named(size: float, warns: bool) -> None:
    vertices = size * 0.12 / np.sqrt(3) * np.array([[0.0, 0, 0], [1, 1, 1]])
    made = Reconstruction(vertices, np.zeros((0, 3), np.int64), 2, np.arange(2), spheres.SIDE)
    remarks = [*size_remark(made, Observation(None, scale=0.5 / 0.12), 0.12, 0.5)]
    assert remarks == warns * [f"warning: the surface's diagonal is {size * 0.12:.2g} m, the object's 0.12 m: much of it is a guess"]


@pytest.mark.parametrize(
    ("out", "source", "options", "error", "words"),
    [
        (
            "ball.ply",
            ("a", [0]),
            {"configuration": "occluded"},
            StageError,
            "no model occluded: its models are implicit-any, none, occluded-",
        ),
        ("ball.stl", ("a", [0]), {}, InvalidInput, ".stl"),
        ("taken.ply", ("a", [0]), {}, InvalidInput, "taken.ply is a folder"),
        ("taken.txt/ball.ply", ("a", [0]), {}, InvalidInput, "taken.txt is a file"),
        ("ball.ply", ("a", [5]), {}, StoreError, "no grasp 5; there are grasps 0 to 4"),
        ("ball.ply", ("a", [99]), {"configuration": "unoccluded"}, StoreError, "no grasp 99"),
        ("ball.ply", ("a", []), {}, StageError, "at least"),
        ("ball.ply", ("a", [1, 0, 1]), {}, StoreError, "a: grasps 1, 0, 1"),
        ("ball.ply", ("z",), {}, StoreError, "no object z"),
        ("ball.ply", ("z",), {"configuration": "none"}, StoreError, "no object z"),
        ("ball.ply", ("a", None, 3), {}, StageError, "model touch takes grasps: use --grasp, not --view 3"),
        ("ball.ply", Path("no.yaml"), {"models": Path("none")}, InvalidInput, "no.yaml cannot be read"),
        ("ball.ply", None, {}, StageError, "needs touches"),
        ("ball.ply", None, {"configuration": "unoccluded"}, StageError, "needs an image: give"),
        ("ball.ply", None, {"configuration": "implicit-any"}, StageError, "needs an image or touches"),
        ("ball.ply", None, {"accelerator": "abacus"}, StageError, "abacus"),
    ],
)
def test_invalid_arguments_are_errors(data, tmp_path, out, source, options, error, words):
    folder = tmp_path / "out"
    (folder / "taken.ply").mkdir(parents=True)
    (folder / "taken.txt").touch()
    source = StoredGrasps(data, *source) if isinstance(source, tuple) else source
    with pytest.raises(error) as raised:
        predict(folder / out, source, PredictOptions(**{"models": data / "models", "configuration": "touch"} | options))
    assert words in str(raised.value)
    assert {path.name for path in folder.iterdir()} == {"taken.ply", "taken.txt"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--data", "D"], "needs an object"),
        (["--data", "D", "--object", "a", "--observation", "g.yaml"], "not both"),
        (["--object", "a"], "--object is of a data directory"),
        (["--grasp", "1"], "--grasp is of a data directory"),
        (["--surface", "shut"], "'shut' is not one of"),
    ],
)
def test_options_of_the_command_that_exclude_each_other_are_errors(tmp_path, options, words):
    assert words in vt("predict", tmp_path / "ball.ply", *options, fails=True)


def test_observations_that_do_not_fit_the_model_are_errors(data, grasp, tmp_path):
    def refused(words, configuration="touch", models=data / "models", **changes):
        with pytest.raises(PipelineError, match=words):
            predict(tmp_path / "ball.ply", write(tmp_path / "g.yaml", entries(grasp, **changes)), PredictOptions(models, configuration))

    Image.new("RGB", (100, 50)).save(tmp_path / "flat.png")
    Image.new("RGBA", (100, 100)).save(tmp_path / "clear.png")
    touch = entries(grasp)["touches"][0]
    flat, clear = (touch | {"tactile_image": f"{name}.png"} for name in ("flat", "clear"))
    refused("tactile images have 100 x 50 pixels, another shape than the model's 100 x 100", touches=[flat], untouched=None)
    refused("index has 100 x 50 pixels, finger-0 100 x 100", touches=[touch, flat | {"name": "index"}])
    refused("touches.0.tactile_image: .*clear.png has colours RGBA", touches=[clear])
    refused("model touch needs touches", touches=[])
    refused("model unoccluded needs a photograph", "unoccluded", camera=None)
    refused("takes touch charts of photographs by gel_16mm.* and not a photograph by digit", sensor="digit")
    refused("there is no entry objekt, did you mean object", objekt=1)
    bare = tmp_path / "models"
    shutil.copytree(data / "models", bare, ignore=shutil.ignore_patterns("unet*"))
    refused("models has no U-Net, which makes points of tactile images; name the models of a dataset", models=bare)


def test_training_seed_selects_the_model(data, grasp, tmp_path):
    copy = shutil.copytree(data, tmp_path / "data")
    spheres.make_model(copy, "touch", training_seed=1)

    def predicted(name, seed=0):
        return predict(tmp_path / "ball.ply", grasp, PredictOptions(copy / "models", name, training_seed=seed))

    first, second = (predicted("touch", seed) for seed in (0, 1))
    assert not np.array_equal(first.reconstruction.vertices, second.reconstruction.vertices)
    with pytest.raises(StageError, match=r"seed-2 has no model touch: there are none at all; train it with"):
        predicted("touch", 2)
    with pytest.raises(StageError, match=r"has no model tuch: its models are .*; did you mean touch\?"):
        predicted("tuch")


def test_stored_charts_of_another_size_are_refused(data, tmp_path):
    folder = shutil.copytree(DataDirectory(data).folder_path("models/gcn/touch"), tmp_path / "made")
    description = json.loads((folder / "model.json").read_text())
    changed = {"network": description["network"] | {"side": 5}, "charts": {"side": 5}}
    (folder / "model.json").write_text(json.dumps(description | changed))
    shutil.copytree(data / "models", tmp_path / "models")
    publish(tmp_path, "models/gcn/touch", folder, "train-gcn")
    with pytest.raises(StageError, match=r"have 9 vertices, model touch takes 25; run fit-charts with fit-charts.side=5"):
        predict(tmp_path / "ball.ply", StoredGrasps(data, "a"), PredictOptions(tmp_path / "models", "touch"))


@pytest.mark.parametrize("file", ["models/gcn/touch", "models/unet"])
def test_model_with_a_flipped_bit_is_refused(data, grasp, tmp_path, file):
    copy = shutil.copytree(data, tmp_path / "data")
    weights = DataDirectory(copy).folder_path(file) / "model.safetensors"
    content = bytearray(weights.read_bytes())
    content[-1] ^= 1
    weights.write_bytes(content)
    with pytest.raises(StoreError, match=r"model.safetensors differs from what was written; delete .* and run train-"):
        predict(tmp_path / "ball.ply", grasp, PredictOptions(copy / "models", "touch"))


@pytest.mark.parametrize(
    ("charts", "words"), [({"side": 9}, "takes charts of side 3, but .*side=9"), ({"samples": 10**9}, "samples: .* less than or equal")]
)
def test_invalid_chart_settings_of_a_model_are_errors(data, grasp, tmp_path, charts, words):
    folder = shutil.copytree(DataDirectory(data).folder_path("models/gcn/touch"), tmp_path / "made")
    description = json.loads((folder / "model.json").read_text())
    (folder / "model.json").write_text(json.dumps(description | {"charts": charts}))
    shutil.copytree(data / "models", tmp_path / "models")
    publish(tmp_path, "models/gcn/touch", folder, "train-gcn")
    with pytest.raises(StoreError, match=words):
        predict(tmp_path / "ball.ply", grasp, PredictOptions(tmp_path / "models", "touch"))


@pytest.mark.parametrize("suffix", [".ply", ".glb"])
def test_colours_are_those_that_a_reader_of_the_format_sees(tmp_path, suffix):
    ball = trimesh.creation.icosphere(2, 0.1)
    colors = np.random.default_rng(0).integers(40, 256, (len(ball.vertices), 3)).astype(np.uint8)
    write_closed(tmp_path / f"ball{suffix}", ClosedMesh(ball.vertices, ball.faces, colors, np.full(len(colors), True)))
    look = load_mesh(tmp_path / f"ball{suffix}").look
    assert np.abs(look.vertex_color[:, :3] - colors.astype(int)).max() <= 2


def colors_of(mesh: trimesh.Trimesh, suffix: str) -> np.ndarray:
    """Read the sRGB colours (V, 3) of a mesh; those of glTF are linear."""
    colors = np.asarray(mesh.visual.vertex_colors)[:, :3]
    return np.rint(255 * trimesh.visual.color.linear_to_srgb(colors)).astype(int) if suffix == ".glb" else colors.astype(int)
