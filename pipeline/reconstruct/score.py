"""Score another method's mesh files or point clouds, and the pretrained network, as a data directory's own networks are."""

import hashlib
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

from rich.console import Console

from pipeline.config.manifest import load_manifest
from pipeline.config.sources import Object, identity
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.make import make
from pipeline.engine.plan import Request
from pipeline.engine.stage import DatasetStage
from pipeline.errors import InvalidInput
from pipeline.formats.mesh_companions import Companions
from pipeline.models.shipped_weights import DEFAULT, read_card
from pipeline.store import digest
from pipeline.store.digest import hashes_of
from pipeline.store.directory import DataDirectory
from pipeline.store.publish import withdraw
from pipeline.store.storage import Location
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.evaluate.evaluation_files import METHOD_NAME, SHIPPED_SCORES, evaluations, read_root
from stages.evaluate.score import Score, ScoreSettings
from stages.evaluate.scored_files import SUFFIXES, surface_files
from stages.evaluate.shipped import EvaluateShipped, ShippedSettings, fitting_rows, shipped_digest
from stages.evaluate.stage import GraspMeasuringSettings


def score(
    folder: Path,  # OBJECT.SUFFIX of each test object, m, world frame: meshes or point clouds; perhaps folders grasps-N, grasps-N-from-K
    data: Location,
    console: Console,
    *,
    name: str | None = None,  # of the method; by default, the folder's
    grasps: int = 1,  # that the files in the folder itself were made from
    misplaced: bool = False,  # measure reconstructions too that are far from their object, or of quite another size
) -> str:  # the folder of the figures, below the data directory
    """Measure a folder's reconstructions of the test objects as `evaluate` measures networks, into DATA/scores/NAME.

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
    inputs = [artifact for artifact in (TOUCH, VISION) if directory.collection(artifact).shards]
    settings = ScoreSettings(**_settings(directory), method=name, files=files_digest(folder), given=grasps, misplaced=misplaced)
    return _measured(directory, Score(folder, inputs), settings, console)


def files_digest(folder: Path) -> str:
    """Compute the digest of a folder's reconstructions, and of the buffers that .gltf files name: OBJECT.bin."""
    files = [path for path in surface_files(folder) if path.is_file()]
    hashes = hashes_of(folder, [str(path.relative_to(folder)) for path in files])
    for path in (path for path in files if path.suffix.lower() == ".gltf"):
        with suppress(InvalidInput, OSError):  # one that cannot be used is named when all are checked
            for name, content in Companions(path).items():
                hashes[f"{path.relative_to(folder)} {name}"] = hashlib.sha256(content).hexdigest()
    return digest.of_json(hashes)


def score_shipped(data: Location, console: Console) -> list[str]:
    """Measure the pretrained network on the test objects as `evaluate` measures networks, into DATA/scores/shipped.

    Returns the inputs that it was not given, and why.
    """
    directory = DataDirectory(data)
    surfaces = directory.collection(SURFACES)
    rows: list[str] = []
    reasons = ["the dataset has no test objects (`splits` of its manifest)"]
    if not surfaces.shards or any(surfaces.row(name).split == "test" for name in surfaces):
        rows, reasons = fitting_rows(directory)
    if rows:
        settings = ShippedSettings(
            **_settings(directory), configurations=tuple(rows), weights=shipped_digest(), learned_from=_learned_from(directory)
        )
        _measured(directory, EvaluateShipped(), settings, console)
    else:  # what was measured before is of a dataset that is gone
        withdraw(directory.folder_record(SHIPPED_SCORES))
    return reasons


def _learned_from(directory: DataDirectory) -> tuple[str, ...]:
    """Name the test objects that the pretrained network has learned from."""
    if not directory.collection(SURFACES).first.has("source_file"):  # older datasets
        return ()
    manifests = map(load_manifest, read_card(DEFAULT).learned_from)
    learned = {identity(item.source) for manifest in manifests for item in manifest.objects(None) if item.split == "train"}
    rows = ObjectRows(directory.root, ["source_file", "source_sha256"], "test")
    return tuple(name for name in rows.object_ids if learned & {str(rows.read(array, name)) for array in ("source_file", "source_sha256")})


def _settings(directory: DataDirectory) -> dict[str, Any]:
    """Choose the measuring settings: those of the networks' evaluation if there is one."""
    if evaluated := evaluations(directory):
        settings = read_root(directory.verified_folder(evaluated[0]))["settings"]
        measuring = {key: value for key, value in settings.items() if key in GraspMeasuringSettings.model_fields}
    else:
        points = directory.collection(SURFACES).first.array("points").shape[1]
        measuring = {"points": min(ScoreSettings.model_fields["points"].default, points)}
    return measuring | {"closed_resolution": None, "grasps": (1,)}


def _measured(directory: DataDirectory, stage: DatasetStage, settings: Any, console: Console) -> str:
    """Run a stage that measures, if it is not up to date, with the seed of the evaluation or else of the dataset."""
    surfaces = directory.collection(SURFACES)
    record, seed = surfaces.first.record, surfaces.first.record.seed
    if evaluated := evaluations(directory):
        seed = read_root(directory.verified_folder(evaluated[0]))["seed"]
    request = Request(
        stage=stage,
        settings=settings,
        manifest=record.manifest,
        objects=[Object(name, surfaces.row(name).category, {}, surfaces.row(name).split) for name in surfaces],
        preset=record.preset,
        seed=seed,
        data=directory.root,
        options={str(option): value for option, value in record.options.items()},
    )
    make(request, console)
    return stage.writes(settings)
