"""The supplement's last experiment on a folder that this project writes: layout, cameras, training, Table 4."""

import io
from pathlib import Path

import numpy as np
import pytest
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from PIL import Image
from rich.console import Console

from pipeline.config.manifest import Manifest, load_manifest
from pipeline.console import show_tables
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.make import make
from pipeline.engine.plan import Request
from pipeline.errors import InvalidInput, StageError, StoreError
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.metrics.cloud_distances import cloud_distances
from pipeline.reconstruct.predict import PredictOptions, StoredGrasps, predict
from pipeline.store.directory import DataDirectory
from pipeline.tables.evaluation_tables import evaluation_tables, means_by_class
from pipeline.tables.supplement_figures import TABLE_4
from schemas.surfaces import SURFACES
from stages.evaluate.evaluation_files import read_figures
from stages.evaluate.protocols import table_4_figures
from stages.registry import load_stage, resolve
from tests.stages.tiny_dataset import manifest, run_stage
from tools.synthetic_renderings import write_dataset

SMALL = [
    *(f"train-single-image.{text}" for text in ("gcn_layers=3", "gcn_features=12", "encoder_width=0.1", "epochs=2", "loss_points=200")),
    *("train-single-image.samples_per_object=2", "train-single-image.validation_items=1", "evaluate-single-image.points=500"),
    *("evaluate-single-image.views=2", "sample-surfaces.points=2000"),
]
QUIET = Console(file=io.StringIO())
GRASP = Path(__file__).parents[2] / "examples" / "robot_grasp" / "grasp.yaml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Three bottles as ShapeNetCore and 3D-R2N2's renderings have them."""
    data, folder = tmp_path_factory.mktemp("made"), tmp_path_factory.mktemp("folder")
    run_stage(data, "sample-surfaces", manifest(1, 1, 1))
    assert write_dataset(str(data), folder) == 3
    return folder


@pytest.fixture(scope="module")
def objects() -> Manifest:
    return load_manifest("single-image").model_copy(update={"splits": manifest(1, 1, 1).splits})


def run_on(folder: Path, data: Path, objects: Manifest, name: str) -> int:
    """Run a stage; how many objects failed."""
    request = Request(load_stage(name), resolve(name, "draft", SMALL), objects.name, objects.objects(folder), "draft", 0, data)
    return len(make(request, QUIET)[0].failures)


@pytest.fixture(scope="module")
def data(folder, objects, tmp_path_factory) -> Path:
    data = tmp_path_factory.mktemp("data")
    for name in ("sample-surfaces", "read-renderings", "train-single-image", "evaluate-single-image"):
        assert run_on(folder, data, objects, name) == 0
    return data


def seen_by(camera: np.ndarray, mesh: Mesh, pixels: int) -> np.ndarray:
    """(R, R) bool: whether the ray through a pixel's centre, as a projection matrix has it, meets a mesh."""
    rows, cols = np.indices((pixels, pixels)) + 0.5
    directions = np.linalg.solve(camera[:, :3], np.stack([cols, rows, np.ones_like(rows)]).reshape(3, -1)).T.astype(np.float32)
    origins = np.broadcast_to(-np.linalg.solve(camera[:, :3], camera[:, 3]), directions.shape).astype(np.float32)
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, mesh.vertices[mesh.faces].astype(np.float32))
    hit = scene.run(origins, np.ascontiguousarray(directions), query="INTERSECT", output=True)
    return np.asarray(hit["primID"] >= 0).reshape(pixels, pixels)


def test_projection_with_the_metadata_covers_the_rendered_silhouette(data):
    rows = ObjectRows(data, ["silhouette", "rendering_camera", "rendering"], None)
    surfaces = DataDirectory(data).collection(SURFACES)
    for number in range(10):
        name = rows.object_ids[number % 3]
        drawn, camera = (rows.read(array, name, number) for array in ("silhouette", "rendering_camera"))
        expected = seen_by(camera, read_mesh(surfaces.view(name)), 137)
        assert (drawn & expected).sum() / (drawn | expected).sum() >= 0.99
        assert (rows.read("rendering", name, number)[~drawn] == 255).all()


def test_folder_has_the_cited_layout(folder):
    models = [path.relative_to(folder / "ShapeNetRendering") for path in folder.glob("ShapeNetRendering/*/*/rendering")]
    assert sorted(str(path) for path in models) == [f"02876657/{number:04d}/rendering" for number in range(3)]
    one = folder / "ShapeNetRendering" / models[0]
    assert sorted(path.name for path in one.glob("*.png")) == [f"{number:02d}.png" for number in range(24)]
    lines = [[float(word) for word in line.split()] for line in (one / "rendering_metadata.txt").read_text().splitlines()]
    assert np.shape(lines) == (24, 5)
    assert (folder / "ShapeNetCore.v1" / models[0].parent / "model.obj").is_file()


def test_model_with_a_missing_or_empty_image_fails_alone_and_is_read_once_it_exists(folder, objects, tmp_path):
    run_on(folder, tmp_path, objects, "sample-surfaces")
    image = next(folder.glob("ShapeNetRendering/*/*/rendering/05.png"))
    content = image.read_bytes()

    def failure() -> str:
        assert run_on(folder, tmp_path, objects, "read-renderings") == 1
        (reason,) = ObjectRows(tmp_path, ["rendering"], None).failed.values()
        return reason

    try:
        image.unlink()
        assert f"{image} is missing" in failure()
        Image.new("RGBA", (137, 137)).save(image)
        assert f"{image} shows nothing" in failure()
    finally:
        image.write_bytes(content)
    assert run_on(folder, tmp_path, objects, "read-renderings") == 0
    assert ObjectRows(tmp_path, ["rendering"], None).failed == {}


def test_objects_without_renderings_fail_with_the_remedy(tmp_path):
    procedural = manifest(1, 1, 1)
    run_stage(tmp_path, "sample-surfaces", procedural)
    settings = resolve("read-renderings", "draft", [])
    (made,) = make(Request(load_stage("read-renderings"), settings, "tiny", procedural.objects(), "draft", 0, tmp_path), QUIET)
    assert len(made.failures) == 3
    assert "use the manifest single-image" in next(iter(made.failures.values())).reason


def test_evaluation_shows_published_rows_and_names_its_objects(data):
    console = Console(file=io.StringIO(), width=200)
    evaluation = DataDirectory(data).verified_folder("evaluation-single-image")
    show_tables(evaluation_tables(evaluation), console)
    printed = console.file.getvalue()  # type: ignore[attr-defined]
    assert [name for name in TABLE_4 if name not in printed] == []
    assert "of the manifest single-image: 1 test object of 1 class, 2 views each, learned from 1 object;" in " ".join(printed.split())
    found = read_figures(evaluation)
    assert found.keys() == {"single-image", *(f"training object, {how}" for how in ("typical", "by silhouette", "by truth"))}
    values = {metric: found["single-image"].per_case(metric) for metric in ("scaled_chamfer", "f1", "f1_2tau")}
    assert {value.shape for value in values.values()} == {(1, 2)}
    (row,) = (row.cells for row in evaluation_tables(evaluation)[0].rows if row.cells[0] == "ours: single-image")
    factors = {"scaled_chamfer": 1, "f1": 100, "f1_2tau": 100}
    np.testing.assert_allclose(row[1:], [factor * values[metric].mean() for metric, factor in factors.items()])
    assert values["scaled_chamfer"][0, 0] != values["scaled_chamfer"][0, 1]  # another view, another reconstruction


def test_each_view_of_an_object_gives_a_mesh(data, tmp_path):
    models, object_id = data / "models", ObjectRows(data, ["rendering"], "test").object_ids[0]
    made = [
        predict(tmp_path / "out.ply", StoredGrasps(data, object_id, view=view), PredictOptions(models, "single-image")) for view in (0, 3)
    ]
    with pytest.raises(StageError, match="has no model single-image"):
        predict(tmp_path / "out.ply", StoredGrasps(data, object_id, view=0), PredictOptions(models, "single-image", training_seed=1))
    assert made[0].reconstruction.vertices.shape == made[1].reconstruction.vertices.shape
    assert (made[0].reconstruction.vertices != made[1].reconstruction.vertices).any()
    coloured = predict(
        tmp_path / "out.ply", StoredGrasps(data, object_id, view=3), PredictOptions(models, "single-image", resolution=64), "closed"
    ).closed
    assert coloured is not None
    assert coloured.seen.any()
    with pytest.raises(StoreError, match=f"{object_id} has no viewpoint 24; there are viewpoints 0 to 23"):
        predict(tmp_path / "out.ply", StoredGrasps(data, object_id, view=24), PredictOptions(models, "single-image"))
    with pytest.raises(StageError, match="model single-image takes a rendering: use --view, not --grasp 1"):
        predict(tmp_path / "out.ply", StoredGrasps(data, object_id, [1]), PredictOptions(models, "single-image"))
    with pytest.raises(InvalidInput, match=r"was trained on renderings from many sides, .*: name --data, an object and a --view"):
        predict(tmp_path / "out.ply", GRASP, PredictOptions(models, "single-image"))
    with pytest.raises(StageError, match="needs an image: give an observation, or a data directory and an object"):
        predict(tmp_path / "out.ply", None, PredictOptions(models, "single-image"))
    with pytest.raises(StageError, match=r"has no model touch: its models are single-image; choose one of these, or train it with"):
        predict(tmp_path / "out.ply", StoredGrasps(data, object_id), PredictOptions(models, "touch"))


def test_figures_of_two_points_equal_hand_computed_values():
    """In metres 0.01 and 0.02 apart; × 0.5 these are 0.005 and 0.01: squares 2.5e-5 and 1e-4."""
    truth = np.array([[0.0, 0, 0], [1, 0, 0]])
    apart = cloud_distances(np.array([[0.01, 0, 0], [1.02, 0, 0]]), truth)
    chamfer, f1, twice = table_4_figures(apart, scale=0.5, tau=6e-5).values()
    assert chamfer == pytest.approx(1000 * 0.25 * 2 * (1e-4 + 4e-4) / 2)
    assert f1 == pytest.approx(0.5)  # one of two points each way
    assert twice == pytest.approx(1)


def test_mean_of_classes_counts_each_class_once():
    figures = np.array([[[1.0], [3.0]], [[4.0], [4.0]], [[10.0], [10.0]]])  # (object, view, figure)
    means = means_by_class(figures, ["a", "a", "b"])
    assert {name: value.tolist() for name, value in means.items()} == {"a": [3.0], "b": [10.0], "all": [6.5]}


def test_training_may_begin_with_the_network_of_single_images(data):
    settings = resolve("train-single-image", "draft", [*SMALL, f"train-single-image.pretrained={data}/models"])
    description, weights = load_stage("train-single-image").assets(settings)
    assert description.parent.name.startswith("single-image-")
    assert weights.is_file()
