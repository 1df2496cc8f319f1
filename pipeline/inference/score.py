"""Score another method's reconstructions, from a folder of mesh files or point clouds."""

from __future__ import annotations

import re
from pathlib import Path

from rich.console import Console

from pipeline.config.objects import Object
from pipeline.engine.plan import Plan, Request
from pipeline.engine.run import make_plans, run
from pipeline.errors import InvalidInput
from pipeline.store import digest
from pipeline.store.digest import hashes_of
from pipeline.store.directory import DataDirectory
from pipeline.store.publish import FolderOutput
from pipeline.store.storage import Place, exists
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.evaluate.evaluation_files import evaluation_name, read_root
from stages.evaluate.score import Score
from stages.evaluate.scored_files import SUFFIXES, surface_files
from stages.evaluate.settings import METHOD_NAME, ScoreSettings, SurfaceSettings


def score(
    folder: Path, data: Place, console: Console, *, name: str | None = None, grasps: int = 1, misplaced: bool = False
) -> Plan[FolderOutput]:
    """Measure a folder's reconstructions of the test objects as `evaluate` measures networks, into DATA/scores/NAME.

    Parameters
    ----------
    folder
        Holds OBJECT.SUFFIX of each test object, metres, world frame: meshes or point clouds. Folders `grasps-N` in it hold
        reconstructions from N grasps, `grasps-N-from-K` those from grasps K, K + 1, ….
    data
        A data directory. Where its networks were evaluated, the settings and the seed are those of that evaluation.
    console
        Shows progress.
    name
        Of the method; by default, the folder's.
    grasps
        That the files in the folder itself were made from.
    misplaced
        Whether to measure reconstructions too that are far from their object, or of quite another size.

    Returns
    -------
    The plan, which has been run.

    Raises
    ------
    InvalidInput
        Files are missing, unreadable or misplaced: each is named.
    StoreError
        There is no dataset, or something of it is out of date.
    """
    if not folder.is_dir():
        raise InvalidInput(f"{folder} is no folder; name one with a file per test object, OBJECT with a suffix of {', '.join(SUFFIXES)}")
    name = folder.resolve().name if name is None else name
    if not re.fullmatch(METHOD_NAME, name):
        raise InvalidInput(f"--name {name}: a method's name has letters, digits, '.', '_' and '-', at most 100 of them")
    directory = DataDirectory(data)
    surfaces = directory.collection(SURFACES)
    record = surfaces.first.record
    settings, seed = {"points": min(ScoreSettings.model_fields["points"].default, surfaces.first.array("points").shape[1])}, record.seed
    if exists(directory.folder_record(evaluation_name())):
        root = read_root(directory.whole_folder(evaluation_name()))
        settings = {key: value for key, value in root["settings"].items() if key in SurfaceSettings.model_fields}
        seed = root["seed"]
    written = digest.of_json(hashes_of(folder, [str(path.relative_to(folder)) for path in surface_files(folder) if path.is_file()]))
    chosen = settings | {"closed_resolution": None, "grasps": (1,)}
    objects = [Object(name, surfaces.row(name).category, {}, surfaces.row(name).split) for name in surfaces]
    reads = [artifact for artifact in (TOUCH, VISION) if directory.collection(artifact).shards]
    request = Request(
        stage=Score(folder, reads),
        settings=ScoreSettings(**chosen, method=name, files=written, given=grasps, misplaced=misplaced),
        manifest=record.manifest,
        objects=objects,
        preset=record.preset,
        seed=seed,
        data=directory.root,
        options={str(option): value for option, value in record.options.items()},
    )
    (plan,) = make_plans(request)
    if not plan.up_to_date():
        run(plan, console)
    plan.output.refresh()
    return plan
