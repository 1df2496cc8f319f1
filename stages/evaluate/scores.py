"""Scores: methods other than the networks of a data directory, measured as `evaluate` measures these, into DATA/scores/NAME."""

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from pipeline.config.manifest import load_manifest
from pipeline.config.settings import defining
from pipeline.config.sources import Object, identity
from pipeline.dataset.object_rows import ObjectRows, sensors_of
from pipeline.engine.make import make
from pipeline.engine.plan import Request
from pipeline.engine.stage import Cost, DatasetJob
from pipeline.errors import InvalidInput
from pipeline.formats.mesh_companions import Companions
from pipeline.kernels.touch.sensor import Sensor
from pipeline.models.device import device_of
from pipeline.models.families import ROWS, load_reconstructor, load_rows, model_record, rows_of, trained_folder
from pipeline.models.foreign_data import same_gel, size_remarks
from pipeline.models.observation import stored_cameras
from pipeline.models.reconstruction import Reconstructor
from pipeline.models.shipped_weights import SHIPPED, read_card, shipped_models, shipped_network
from pipeline.models.touch_model import load_touch_model
from pipeline.store import digest
from pipeline.store.digest import hashes_of
from pipeline.store.directory import DataDirectory
from pipeline.store.publish import withdraw
from pipeline.store.record import library_versions
from pipeline.store.storage import Location
from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.evaluate.evaluation_files import METHOD_NAME, SHIPPED_ROWS, SHIPPED_SCORES, evaluations, read_root
from stages.evaluate.measure import Method, Network
from stages.evaluate.protocols import GraspProtocol
from stages.evaluate.scored_files import SUFFIXES, Files, surface_files
from stages.evaluate.stage import Evaluation, GraspMeasuringSettings, artifacts_of


class ScoreSettings(GraspMeasuringSettings):
    """Choose which files `vt-pipeline score` measures, and how; these settings are the command's."""

    method: str = defining(..., "name of the method, in tables", pattern=METHOD_NAME)
    files: str = defining(..., "SHA-256 of all files of the folder, with their names")
    given: int = defining(1, "grasps that the files in the folder itself were made from", ge=1)
    misplaced: bool = defining(False, "whether reconstructions that are far from their objects are measured too")


class ShippedSettings(GraspMeasuringSettings):
    """Choose the inputs of a pretrained network; these settings are those of `vt-pipeline report --shipped`."""

    configurations: tuple[str, ...] = defining(..., "its inputs: rows of the tables")
    weights: str = defining(..., "SHA-256 of the record of the weights")
    learned_from: tuple[str, ...] = defining((), "test objects that it has learned from")
    not_learned: tuple[str, ...] = defining((), "what of the dataset it has not learned: sizes, gels, cameras")


class Score(Evaluation):
    """Measure methods with the draws of `evaluate`, so that a network's own meshes get its own figures."""

    name = "score"
    summary = "Reconstructions by any method, measured as `evaluate` measures networks."
    settings_type = GraspMeasuringSettings

    def __init__(
        self,
        folder: str,  # to fill, below the data directory
        methods: Sequence[Method],
        artifacts: Sequence[Artifact],  # that they and the baselines beside them take, apart from surfaces and grasps
    ) -> None:
        self.folder, self.measured, self.artifacts = folder, methods, artifacts

    def inputs(self, settings: Any) -> tuple[Artifact, ...]:
        return (SURFACES, GRASPS, *self.artifacts)

    def writes(self, settings: Any) -> str:
        return self.folder

    def cost(self, settings: Any, objects: int) -> Cost:
        """Estimate a second and 200 kB per object: five reconstructions of a fifth of them."""
        return Cost(seconds=objects, kilobytes=200 * objects)

    def methods(self, job: DatasetJob) -> Sequence[Method]:
        return self.measured

    def protocol(self, job: DatasetJob, methods: Sequence[Method]) -> GraspProtocol:
        return GraspProtocol(job, methods)

    def attributes(self, job: DatasetJob, protocol: Any) -> dict[str, Any]:
        """Return the version, for those who cite the score."""
        return {"vt_pipeline": library_versions()["vt-pipeline"]}

    def run(self, directory: DataDirectory, settings: GraspMeasuringSettings, console: Console) -> str:
        """Measure, if it is not up to date, with the seed of the evaluation or else of the dataset; return the filled folder's name."""
        surfaces = directory.collection(SURFACES)
        record, seed = surfaces.first.record, surfaces.first.record.seed
        if evaluated := evaluations(directory):
            seed = read_root(directory.verified_folder(evaluated[0]))["seed"]
        objects = [Object(name, surfaces.row(name).category, {}, surfaces.row(name).split) for name in surfaces]
        options = {str(option): value for option, value in record.options.items()}
        make(Request(self, settings, record.manifest, objects, record.preset, seed, directory.root, options=options), console)
        return self.folder


def score(
    folder: Path,  # OBJECT.SUFFIX of each test object, m, world frame: meshes or point clouds; perhaps folders grasps-N, grasps-N-from-K
    data: Location,
    console: Console,
    *,
    name: str | None = None,  # of the method; by default, the folder's
    grasps: int = 1,  # that the files in the folder itself were made from
    misplaced: bool = False,  # measure reconstructions too that are far from their object, or of quite another size
) -> str:  # the folder of the figures, below the data directory
    """Measure a folder's reconstructions of the test objects.

    Where the networks of the data directory were evaluated, the settings and the seed are those of that evaluation.
    """
    if not folder.is_dir():
        raise InvalidInput(f"{folder} is no folder; name one with a file per test object, OBJECT with a suffix of {', '.join(SUFFIXES)}")
    name = folder.resolve().name if name is None else name
    if not re.fullmatch(METHOD_NAME, name):
        raise InvalidInput(f"{name!r} cannot be a method's name; give one with --name, of letters, digits, '.', '_' and '-', at most 100")
    if f"scores/{name}" == SHIPPED_SCORES:
        raise InvalidInput(f"--name {name}: that is the pretrained network, which `report --shipped` measures; choose another name")
    directory = DataDirectory(data)
    artifacts = [artifact for artifact in (TOUCH, VISION) if directory.collection(artifact).shards]
    image = "unoccluded" if VISION in artifacts else None
    files = Files(name, folder, grasps, misplaced=misplaced, image=image, touch=TOUCH in artifacts)
    settings = ScoreSettings(**measuring_settings(directory), method=name, files=files_digest(folder), given=grasps, misplaced=misplaced)
    return Score(f"scores/{name}", [files], artifacts).run(directory, settings, console)


def files_digest(folder: Path) -> str:
    """Compute the digest of a folder's reconstructions, and of the buffers that .gltf files name: OBJECT.bin."""
    files = [path for path in surface_files(folder) if path.is_file()]
    hashes = hashes_of(folder, [str(path.relative_to(folder)) for path in files])
    for path in (path for path in files if path.suffix.lower() == ".gltf"):
        with suppress(InvalidInput, OSError):  # one that cannot be used is named when all are checked
            for name, content in Companions(path).items():
                hashes[f"{path.relative_to(folder)} {name}"] = hashlib.sha256(content).hexdigest()
    return digest.of_json(hashes)


def measuring_settings(directory: DataDirectory) -> dict[str, Any]:
    """Choose the measuring settings: those of the networks' evaluation if there is one."""
    if evaluated := evaluations(directory):
        settings = read_root(directory.verified_folder(evaluated[0]))["settings"]
        measuring = {key: value for key, value in settings.items() if key in GraspMeasuringSettings.model_fields}
    else:
        points = directory.collection(SURFACES).first.stored("points").shape[1]
        measuring = {"points": min(GraspMeasuringSettings.model_fields["points"].default, points)}
    return measuring | {"closed_resolution": None, "grasps": (1,)}


def score_shipped(data: Location, console: Console, network: str | None = None) -> list[str]:
    """Measure a pretrained network on the test objects, by default that for their size; name the inputs it was not given, and why."""
    directory = DataDirectory(data)
    surfaces = directory.collection(SURFACES)
    has_tests = any(surfaces.row(name).split == "test" for name in surfaces)
    network = network or shipped_network(median_diagonal(directory) if has_tests else None)
    if surfaces.shards and not has_tests:
        rows, reasons = list[str](), ["the dataset has no test objects (`splits` of its manifest)"]
    else:
        rows, reasons = fitting_rows(directory, network)
    if not rows:  # what was measured before is of a dataset that is gone
        withdraw(directory.folder_record(SHIPPED_SCORES))
        return reasons
    models = load_rows(dict.fromkeys(rows, trained_folder(shipped_models(), network)), device_of("auto"))
    of_gels = is_given_gels(directory, next(iter(models.values())))
    settings = ShippedSettings(
        **measuring_settings(directory),
        configurations=tuple(rows),
        weights=shipped_digest(network),
        learned_from=learned_objects(directory, network),
        not_learned=tuple(dict.fromkeys(not_learned(directory, models, of_gels=of_gels))),
    )
    networks = [
        Network(SHIPPED_ROWS + name.removeprefix(f"{network}-"), model, first_only=True, foreign=True, of_gels=of_gels)
        for name, model in models.items()
    ]
    artifacts = [artifact for artifact in artifacts_of(rows) if artifact is not CHARTS or not of_gels]
    Score(SHIPPED_SCORES, networks, artifacts).run(directory, settings, console)
    return reasons


def median_diagonal(directory: DataDirectory) -> float:
    """Compute the median diagonal of the test objects that have not failed, m."""
    rows = ObjectRows(directory.root, ["points"], "test")
    return float(np.median([rows.diagonal(object_id) for object_id in rows.object_ids]))


def is_given_gels(directory: DataDirectory, model: Reconstructor) -> bool:
    """Check whether a pretrained network is given depth maps: it learned from gels, or from charts of another gel than the dataset's."""
    ours, touch = shipped_chart_sensor(), directory.collection(TOUCH)
    sensors = sensors_of(touch.first) if touch.shards else ()
    return not model.config.takes_charts or (ours is not None and not all(same_gel(ours, sensor) for sensor in sensors))


def shipped_chart_sensor() -> Sensor | None:
    """Read the sensor whose touch charts the pretrained `implicit-any` has learned from; None if that is not known."""
    models = shipped_models()
    return load_touch_model(DataDirectory(models).verified_folder("unet"), "cpu").sensor if (models / "unet.json").exists() else None


def not_learned(directory: DataDirectory, models: Mapping[str, Reconstructor], *, of_gels: bool) -> Iterator[str]:
    """Say what of a dataset's test objects a pretrained network has not learned, as `predict` does of one object."""
    model = next(iter(models.values()))
    images = any(row.config.image for row in models.values())
    rows = ObjectRows(directory.root, ["points", *(["projection"] if images else [])], "test")
    touch = any(row.config.touch for row in models.values())
    sensors = sensors_of(directory.collection(TOUCH).first) if touch else ()
    yield from size_remarks(model.trained, [rows.diagonal(object_id) for object_id in rows.object_ids], sensors, shipped_chart_sensor())
    if touch and of_gels:
        yield "touches are points of the exact depth maps"
    cameras = (camera for object_id in rows.object_ids if images for camera in stored_cameras(rows, object_id, model.config))
    if not all(map(model.trained.has_view, cameras)):
        yield "images are turned and zoomed to the camera that it was trained with"


def learned_objects(directory: DataDirectory, network: str) -> tuple[str, ...]:
    """Name the test objects that a pretrained network has learned from."""
    learned: set[str] = set()
    for manifest in map(load_manifest, read_card(network).learned_from):
        sources = tuple(source for source in manifest.sources if source.split in (None, "train"))  # others need not be installed
        objects = manifest.model_copy(update={"sources": sources}).objects(None)
        learned |= {identity(item.source) for item in objects if item.split == "train"}
    rows = ObjectRows(directory.root, ["source_file", "source_sha256"], "test")
    return tuple(name for name in rows.object_ids if learned & {str(rows.read(array, name)) for array in ("source_file", "source_sha256")})


def shipped_digest(network: str) -> str:
    """Compute the SHA-256 of a pretrained network's record, which names every file of the weights by its digest; empty if there is none."""
    record = SHIPPED / model_record(network)
    return hashlib.sha256(record.read_bytes()).hexdigest() if record.exists() else ""


def fitting_rows(directory: DataDirectory, network: str) -> tuple[list[str], list[str]]:
    """Choose the rows whose inputs a dataset has; say why the others are skipped."""
    model = load_reconstructor(network, trained_folder(shipped_models(), network))
    reasons = _missing_inputs(directory, model)
    rows = []
    for name in rows_of(network):
        inputs = ROWS[name].inputs
        takes = {*([inputs.image] if inputs.image else []), *(["touch"] if inputs.touch else [])}
        if takes and not takes & reasons.keys():
            rows.append(name)
    return rows, [f"{kind}: {why}" for kind, why in reasons.items()]


def _missing_inputs(directory: DataDirectory, model: Reconstructor) -> dict[str, str]:
    """Name the inputs that the dataset cannot give the network, with the reason."""
    images, charts = directory.collection(VISION), directory.collection(CHARTS)
    missing: dict[str, str] = {}
    for kind in ("occluded", "unoccluded"):
        if not images.shards or (kind == "occluded" and not images.first.has(kind)):
            missing[kind] = "render-vision has not made it"
    if is_given_gels(directory, model):
        return missing if directory.collection(TOUCH).shards else missing | {"touch": "simulate-touch has not been run"}
    if not charts.shards:
        missing["touch"] = "fit-charts has not been run"
    elif (vertices := charts.first.stored("vertices").shape[-2]) != model.config.side**2:
        missing["touch"] = f"charts have {vertices} vertices, it takes {model.config.side**2}"
    return missing
