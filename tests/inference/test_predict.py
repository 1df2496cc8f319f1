import json
import shutil
from pathlib import Path

import igl
import numpy as np
import pytest
import torch
import trimesh
from PIL import Image
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.dataset.grasp_dataset import GraspDataset
from pipeline.errors import InvalidInput, PipelineError, StageError, StoreError
from pipeline.inference.mesh_files import TOUCH_COLOR, VISION_COLORS
from pipeline.inference.predict import predict
from pipeline.kernels.charts.vision_charts import CHART_VERTICES, vision_charts
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.tactile_image import untouched_image
from pipeline.models.reconstruction import join_vision_charts
from pipeline.models.touch_model import save_touch_model
from pipeline.store.directory import DataDirectory
from tests.engine.tiny_stages import publish
from tests.stages import ball_dataset as spheres

FELT = 3  # of a grasp's four sensors


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    torch.set_num_threads(1)
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, 1)
    for name in ("none", "touch", "occluded-touch", "unoccluded"):
        spheres.make_model(folder, name, still=name == "none")
    (unet := folder / "made").mkdir()
    with torch.random.fork_rng():
        torch.manual_seed(0)
        save_touch_model(unet, UNet(8), sensor=spheres.SENSOR, untouched=untouched_image(spheres.SENSOR), mask_threshold=1e-3)
    publish(folder, "models/unet", unet, "train-unet")
    return folder


@pytest.fixture(scope="module")
def files(data, tmp_path_factory):
    """Write grasp 2 as a user's files: an image, four tactile images, a file of poses."""
    folder = tmp_path_factory.mktemp("files")
    item = GraspDataset(data, ["occluded", "tactile_image", "sensor_pose", "touch_success"], "test")[2]
    Image.fromarray(item["occluded"][0].numpy()).save(folder / "image.png")
    for number, tactile_image in enumerate(item["tactile_image"].numpy()):
        Image.fromarray(tactile_image).save(folder / f"touch-{number}.png")
    poses, touched = item["sensor_pose"].numpy(), item["touch_success"].numpy()
    (folder / "poses.json").write_text(json.dumps({"poses": poses.tolist(), "touched": touched.tolist()}))
    (folder / "unsaid.json").write_text(json.dumps(poses.tolist()))
    np.savez(folder / "poses.npz", poses=poses, touched=touched)
    return folder


def tactile_images(files: Path) -> list[Path]:
    return [files / f"touch-{number}.png" for number in range(4)]


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
def test_a_stored_grasp_becomes_charts_and_a_joined_surface(data, tmp_path, suffix):
    made = predict(tmp_path / f"ball{suffix}", data / "models", "occluded-touch", data=data, object_id="a", grasps=[2])
    assert [path.name for path in made.files] == [f"ball{suffix}", f"ball-joined{suffix}"]
    assert list(made.touched) == [True, True, False, True]
    apart, together = (trimesh.load_scene(path, process=False).to_mesh() for path in made.files)
    sphere = vision_charts(0)
    assert len(apart.vertices) == 24 * CHART_VERTICES + FELT * spheres.SIDE**2
    assert len(apart.faces) == len(sphere.faces) + FELT * 8
    assert len(together.vertices) == sphere.position.max() + 1 + FELT * spheres.SIDE**2
    upright = apart.vertices[:, [0, 2, 1]] * [1, -1, 1] if suffix == ".glb" else apart.vertices
    np.testing.assert_allclose(np.sort(upright, axis=0), np.sort(made.reconstruction.vertices, axis=0), atol=1e-6)
    orange = (np.asarray(apart.visual.vertex_colors)[:, :3] == TOUCH_COLOR[:3]).all(axis=1)
    assert orange.sum() == FELT * spheres.SIDE**2
    assert not list(tmp_path.glob("*.tmp"))


@pytest.mark.parametrize("suffix", [".obj", ".glb"])
def test_every_chart_has_its_name(data, tmp_path, suffix):
    made = predict(tmp_path / f"ball{suffix}", data / "models", "touch", data=data, object_id="a", grasps=[0, 1], surface="charts")
    assert [path.name for path in made.files] == [f"ball{suffix}"]
    if suffix == ".obj":
        names = [line.split()[1] for line in made.files[0].read_text().splitlines() if line.startswith(("o ", "g "))]
    else:
        names = list(trimesh.load_scene(made.files[0], process=False).geometry)
    assert sorted(names) == sorted([*(f"touch_{n:02d}" for n in range(2 * FELT)), *(f"vision_{n:03d}" for n in range(24))])


def test_the_joined_surface_is_closed(data, tmp_path):
    made = predict(tmp_path / "ball.ply", data / "models", "none", data=data, object_id="a", surface="joined").reconstruction
    surface = trimesh.Trimesh(*join_vision_charts(made), process=False)
    assert surface.is_watertight
    assert surface.is_winding_consistent
    assert surface.euler_number == 2
    assert surface.volume > 0
    np.testing.assert_allclose(
        np.linalg.norm(surface.vertices - spheres.CENTRE, axis=1), 0.25, rtol=1e-6
    )  # nothing moved: averages of equals


def test_the_command_says_what_the_closed_mesh_is_made_of(data, tmp_path):
    asked = ["predict", str(tmp_path / "ball.ply"), "--data", str(data), "--object", "a", "--resolution", "16"]
    wrong = CliRunner().invoke(app, [*asked, "--configuration", "none", "--surface", "shut"])
    assert wrong.exit_code == 1
    assert "it is one of charts, joined, both, closed" in " ".join(wrong.output.split())
    guessed = CliRunner().invoke(app, [*asked, "--configuration", "none", "--surface", "closed"])
    assert "no touch, so that no place of it is certain; no colour" in " ".join(guessed.output.split())
    felt = CliRunner().invoke(app, [*asked, "--configuration", "touch", "--surface", "closed"])
    assert f"faces, {FELT} touches; no colour" in " ".join(felt.output.split())


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
def test_the_closed_mesh_goes_through_the_touches_and_has_the_image_s_colours(data, tmp_path, suffix):
    asked = {"data": data, "object_id": "a", "grasps": [2], "surface": "closed", "resolution": 24}
    made = predict(tmp_path / f"ball{suffix}", data / "models", "occluded-touch", **asked)
    mesh, shape = trimesh.load_scene(made.files[0], process=False).to_mesh(), made.reconstruction
    assert made.files == [tmp_path / f"ball{suffix}"]
    assert mesh.is_watertight
    assert mesh.body_count == 1
    assert mesh.volume > 0
    upright = mesh.vertices[:, [0, 2, 1]] * [1, -1, 1] if suffix == ".glb" else np.asarray(mesh.vertices)
    np.testing.assert_allclose(upright, made.closed.vertices, atol=1e-6)
    felt = shape.vertices[shape.vision :]
    assert len(felt) == FELT * spheres.SIDE**2
    assert np.sqrt(igl.point_mesh_squared_distance(felt, upright, np.asarray(mesh.faces))[0]).max() <= 5e-4
    colors = np.asarray(mesh.visual.vertex_colors)
    assert (colors[~made.closed.seen] == VISION_COLORS[0]).all()
    np.testing.assert_array_equal(colors[made.closed.seen, :3], made.closed.colors[made.closed.seen])


def test_a_closed_mesh_of_a_network_that_sees_and_feels_nothing_is_grey(data, tmp_path):
    made = predict(tmp_path / "ball.ply", data / "models", "none", data=data, object_id="a", surface="closed", resolution=16)
    assert not made.closed.seen.any()
    mesh = trimesh.load(made.files[0], process=False)
    assert (np.asarray(mesh.visual.vertex_colors) == VISION_COLORS[0]).all()
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.25**3, rel=0.1)


def test_files_give_what_the_store_gives(data, files, tmp_path):
    bare = tmp_path / "uncharted"
    shutil.copytree(data, bare, ignore=shutil.ignore_patterns("charts"))
    stored = predict(tmp_path / "a.ply", data / "models", "occluded-touch", data=bare, object_id="a", grasps=[2])
    for poses in ("poses.json", "poses.npz", "unsaid.json"):
        given = {"image": files / "image.png", "tactile_images": tactile_images(files), "poses": files / poses}
        own = predict(tmp_path / "b.ply", data / "models", "occluded-touch", **given)
        assert (own.touched == stored.touched).all()
        np.testing.assert_array_equal(own.reconstruction.faces, stored.reconstruction.faces)
        # the charts are fitted from other seeds to the same clouds
        np.testing.assert_allclose(own.reconstruction.vertices, stored.reconstruction.vertices, atol=5e-3)
    again = predict(tmp_path / "c.ply", data / "models", "occluded-touch", **given)
    assert (again.reconstruction.vertices == own.reconstruction.vertices).all()
    assert again.files[0].read_bytes() == own.files[0].read_bytes()


@pytest.mark.parametrize(("configuration", "asked"), [("none", {"object_id": "typo"}), ("unoccluded", {"object_id": "a", "grasps": [99]})])
def test_what_is_not_there_is_missed_by_networks_that_do_not_feel_too(data, tmp_path, configuration, asked):
    with pytest.raises(StoreError, match=r"no object typo|no grasp 99"):
        predict(tmp_path / "a.ply", data / "models", configuration, data=data, **asked)


def test_charts_that_stand_are_taken_as_they_are(data, tmp_path):
    made = predict(tmp_path / "a.obj", data / "models", "touch", data=data, object_id="a", grasps=[1]).reconstruction
    charts = GraspDataset(data, ["vertices", "stop_rule"], "test")[1]
    felt = charts["vertices"][charts["stop_rule"] > 0].reshape(-1, 3).double().numpy()
    np.testing.assert_array_equal(made.vertices[made.vision :], felt)


@pytest.mark.parametrize(
    ("asked", "error", "words"),
    [
        ({"configuration": "occluded"}, StageError, r"no model occluded: its models are none, occluded-touch"),
        ({"out": "ball.stl"}, InvalidInput, r"\.stl"),
        ({"out": "taken.ply"}, InvalidInput, "taken.ply is a folder"),
        ({"grasps": [5]}, StoreError, "no grasp 5; there are grasps 0 to 4"),
        ({"grasps": []}, StageError, "at least"),
        ({"object_id": "z"}, StoreError, "no object z"),
        ({"object_id": None}, StageError, "give a data directory and an object, or files, not both"),
        ({"image": "image.png"}, StageError, "not both"),
        ({"data": None}, StageError, "object a needs a data directory"),
        ({"data": None, "object_id": None}, StageError, "needs tactile images and the sensors' poses, but none is given"),
        ({"data": None, "object_id": None, "configuration": "unoccluded"}, StageError, "needs an image"),
        ({"accelerator": "abacus"}, StageError, "abacus"),
    ],
)
def test_what_cannot_be_predicted_is_an_error(data, tmp_path, asked, error, words):
    plain = {"out": "ball.ply", "models": data / "models", "configuration": "touch", "data": data, "object_id": "a", "grasps": [0]} | asked
    out = tmp_path / "out" / plain.pop("out")
    (tmp_path / "out" / "taken.ply").mkdir(parents=True)
    with pytest.raises(error, match=words):
        predict(out, plain.pop("models"), plain.pop("configuration"), **plain)
    assert [path.name for path in out.parent.iterdir()] == ["taken.ply"]


def test_files_that_do_not_fit_are_errors(data, files, tmp_path):
    given = {"tactile_images": tactile_images(files), "poses": files / "poses.json"}

    def refused(words, **changes):
        with pytest.raises(PipelineError, match=words):
            predict(tmp_path / "ball.ply", data / "models", changes.pop("configuration", "touch"), **(given | changes))

    refused("3 tactile images and 4 poses", tactile_images=tactile_images(files)[:3])
    small = tmp_path / "small.png"
    Image.new("RGB", (50, 50)).save(small)
    refused("50", tactile_images=[small] * 4)
    refused(r"small.png has \(50, 50\)", tactile_images=[*tactile_images(files)[:3], small])
    refused("trained on images", configuration="unoccluded", image=small, tactile_images=[], poses=None)
    refused("takes no touch", configuration="unoccluded", image=small)
    refused("takes no image", image=files / "image.png")
    refused("cannot be read as an image", tactile_images=[files / "poses.json"] * 4)
    clear = tmp_path / "clear.png"
    Image.new("RGBA", (100, 100)).save(clear)
    refused("RGBA", tactile_images=[clear] * 4)
    bare = tmp_path / "models"
    shutil.copytree(data / "models", bare, ignore=shutil.ignore_patterns("unet*"))
    with pytest.raises(StageError, match="models has no U-Net, which makes points of tactile images; name the models of a data directory"):
        predict(tmp_path / "ball.ply", bare, "touch", **given)


def test_another_training_is_used_where_it_is_asked_for(data, files, tmp_path):
    copy = shutil.copytree(data, tmp_path / "data")
    spheres.make_model(copy, "touch", training_seed=1)
    given = {"tactile_images": tactile_images(files), "poses": files / "poses.json"}
    first, second = (predict(tmp_path / "ball.ply", copy / "models", "touch", training_seed=seed, **given) for seed in (0, 1))
    assert not np.array_equal(first.reconstruction.vertices, second.reconstruction.vertices)
    with pytest.raises(StageError, match=r"seed-2 has no model touch: there are none at all; train it with"):
        predict(tmp_path / "ball.ply", copy / "models", "touch", training_seed=2, **given)


def test_stored_charts_of_another_size_are_an_error(data, tmp_path):
    made = shutil.copytree(DataDirectory(data).folder_path("models/gcn/touch"), tmp_path / "made")
    description = json.loads((made / "model.json").read_text())
    (made / "model.json").write_text(json.dumps(description | {"network": description["network"] | {"side": 5}}))
    shutil.copytree(data / "models", tmp_path / "models")
    publish(tmp_path, "models/gcn/touch", made, "train-gcn")
    with pytest.raises(StageError, match=r"have 9 vertices, model touch takes 25; run fit-charts with fit-charts.side=5"):
        predict(tmp_path / "ball.ply", tmp_path / "models", "touch", data=data, object_id="a")


@pytest.mark.parametrize("file", ["models/gcn/touch", "models/unet"])
def test_a_model_of_which_a_bit_flipped_is_not_used(data, files, tmp_path, file):
    copy = shutil.copytree(data, tmp_path / "data")
    weights = DataDirectory(copy).folder_path(file) / "model.safetensors"
    content = bytearray(weights.read_bytes())
    content[-1] ^= 1
    weights.write_bytes(content)
    with pytest.raises(StoreError, match=r"model.safetensors differs from what was written; delete .* and run train-"):
        predict(tmp_path / "ball.ply", copy / "models", "touch", tactile_images=tactile_images(files), poses=files / "poses.json")


def test_a_file_beside_a_models_own_is_no_fault(data, tmp_path):
    copy = shutil.copytree(data, tmp_path / "data")
    (DataDirectory(copy).folder_path("models/gcn/none") / "notes.txt").write_text("mine")
    assert predict(tmp_path / "ball.ply", copy / "models", "none").files


@pytest.mark.parametrize(
    ("charts", "words"), [({"side": 9}, "takes charts of side 3, but .*side=9"), ({"samples": 10**9}, "samples: .* less than or equal")]
)
def test_chart_settings_that_cannot_be_used_are_errors(data, files, tmp_path, charts, words):
    made = shutil.copytree(DataDirectory(data).folder_path("models/gcn/touch"), tmp_path / "made")
    description = json.loads((made / "model.json").read_text())
    (made / "model.json").write_text(json.dumps(description | {"charts": charts}))
    shutil.copytree(data / "models", tmp_path / "models")
    publish(tmp_path, "models/gcn/touch", made, "train-gcn")
    with pytest.raises(StoreError, match=words):
        predict(tmp_path / "ball.ply", tmp_path / "models", "touch", tactile_images=tactile_images(files), poses=files / "poses.json")
