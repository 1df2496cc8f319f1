"""Commands about learning: sweeps over hyperparameters, reports, and the use of trained models."""

import shlex
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, cast, get_args

import typer
import yaml
from rich.markup import escape

from pipeline.cli.completion import complete_made_object, complete_stage
from pipeline.cli.failures import fail
from pipeline.cli.request import (
    DataArgument,
    DataOption,
    ManifestOption,
    ObjectsOption,
    PresetOption,
    SeedOption,
    SetOption,
)
from pipeline.cli.run import print_made
from pipeline.config.settings import Settings
from pipeline.console import console, errors, pluralise, print_line, show_tables
from pipeline.engine.make import make
from pipeline.errors import StageError
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import as_location
from pipeline.tradeoff import sweep as sweeps
from stages.registry import STAGES, assignment, load_stage, make_request, resolve

SINGLE = "evaluation-single-image"


def sweep(
    stage: Annotated[str, typer.Argument(help="A stage that trains.", autocompletion=complete_stage)],
    grid: Annotated[list[str] | None, typer.Option(help="SETTING=VALUE,VALUE,… to try; without any, the supplement's grid.")] = None,
    manifest: ManifestOption = "toy",
    preset: PresetOption = "draft",
    data: DataOption = None,
    objects: ObjectsOption = None,
    assignments: SetOption = None,
    seed: SeedOption = None,
    dry_run: Annotated[bool, typer.Option(help="List the points, and do nothing.")] = False,
) -> None:
    """Train over a grid of hyperparameters.

    By default the grid is the supplement's (2.2 and 3.4). A sweep that was killed continues when it is run again.
    """
    request = make_request(stage, manifest, preset, data=data, objects=objects, assignments=assignments or (), seed=seed)
    loaded = request.stage
    if not getattr(loaded, "trains", False):
        trainings = [name for name in STAGES if getattr(load_stage(name), "trains", False)]
        fail(f"{stage} trains nothing: sweep over settings of {', '.join(trainings)}")
    default_grid = loaded.grid(request.settings)
    if not (grid or default_grid):
        fail(f"the supplement has no grid for {stage}: name one, --grid learning_rate=1e-3,2e-3")
    finished, failed = [], 0

    def settings_of(point: Mapping[str, Any]) -> Settings:
        varied = [f"{stage}.{assignment(setting, value)}" for setting, value in point.items()]
        return resolve(stage, preset, [*(assignments or ()), *varied])

    every_point = sweeps.grid_points(_grid(grid) if grid else default_grid)
    points = [(point, settings_of(point)) for point in every_point]  # all are valid, or none is run
    for point, settings in points:
        folder = sweeps.point_folder(stage, loaded.writes(settings), point)
        if dry_run:
            print_line(f"{request.data / folder}")
            continue
        try:
            make(replace(request, settings=settings, folder=folder), console, report=print_made)
            finished.append((point, DataDirectory(request.data).folder(folder)))
        except StageError as error:  # a learning rate that is too high fails this point only
            failed += 1
            errors.print(f"[yellow]failed[/] {escape(folder)}: {escape(str(error))}")
    if finished:
        sweeps.show_sweep(finished, console)
    if failed:
        fail(f"{pluralise(failed, 'point')} failed, see above")


def predict(
    out: Annotated[
        Path,
        typer.Argument(help="Mesh file to write: .obj, .ply or .glb. Metres, world frame, or the observation's; GLB is in metres, y up."),
    ],
    configuration: Annotated[
        str | None,
        typer.Option(help="Which model of MODELS: touch, implicit-any, …; by default occluded-touch, of pretrained ones implicit-any."),
    ] = None,
    data: Annotated[str | None, typer.Option(help="Data directory; with --object, instead of files.")] = None,
    models: Annotated[
        str | None,
        typer.Option(help="Folder of trained models, or shipped; by default DATA/models, else the pretrained ones."),
    ] = None,
    object_id: Annotated[
        str | None, typer.Option("--object", help="An object of the data directory.", autocompletion=complete_made_object)
    ] = None,
    grasps: Annotated[list[int] | None, typer.Option("--grasp", min=0, help="A grasp of the object, from 0; repeat for several.")] = None,
    view: Annotated[int, typer.Option(min=0, help="A rendering of the object, from 0; for single-image.")] = 0,
    observation: Annotated[
        Path | None, typer.Option(help="YAML file of what a robot saw and felt (docs/guide/own-photographs.md); instead of --data.")
    ] = None,
    training_seed: Annotated[int, typer.Option(min=0, help="Which training of the model, where there are several.")] = 0,
    surface: Annotated[str, typer.Option(help="charts, joined (at their seams), both, or closed: one smooth watertight mesh.")] = "both",
    resolution: Annotated[int, typer.Option(min=64, max=400, help="Edges of the closed mesh along its longest side.")] = 128,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the chart fitting.")] = 0,
) -> None:
    """Reconstruct an object from one or several grasps.

    The grasps are those of a data directory, or what an observation file describes: it is checked as a whole before anything runs.
    """
    from pipeline.models.shipped_weights import models_place
    from pipeline.reconstruct import predict as prediction

    if surface not in get_args(prediction.Surface):
        fail(f"--surface {surface}: it is one of {', '.join(get_args(prediction.Surface))}")
    source: prediction.Source = observation
    if data is not None:
        if observation is not None:
            fail("give a data directory and an object, or an observation, not both")
        if object_id is None:
            fail(f"data directory {data} needs an object; name one of its objects with --object")
        source = prediction.StoredGrasps(as_location(data), object_id, grasps, view)
    elif object_id is not None or grasps or view:
        option = "--object" if object_id is not None else "--grasp" if grasps else "--view"
        fail(f"{option} is of a data directory: name --data and --object, or omit it")
    options = prediction.PredictOptions(
        models_place(models) if models else None, configuration, training_seed, seed=seed, resolution=resolution
    )
    result = prediction.predict(out, source, options, cast(prediction.Surface, surface))
    for line in result.remarks:
        print_line(line)
    if (mesh := result.closed) is not None:
        color = f"{mesh.seen.mean():.0%} coloured by the image" if mesh.seen.any() else "no colour: no image shows any of it"
        print_line(f"{result.files[0]}: closed, {len(mesh.vertices)} vertices, {len(mesh.faces)} faces, {result.given_places}; {color}")
        return
    size = f"{len(result.reconstruction.vertices)} vertices, {len(result.reconstruction.faces)} faces, {result.given_places}"
    for path in result.files:
        print_line(f"{path}: {size}")


def demo(folder: Annotated[Path, typer.Argument(help="Folder to write to.")] = Path("demo")) -> None:
    """Reconstruct an object that no training saw, from one image and one grasp.

    The grasp is simulated, and reconstructed by the pretrained network: a closed coloured mesh, and a turntable of it beside the object.
    """
    from pipeline.reconstruct.demo import demo as show

    result = show(folder, console)
    closed = result.prediction.closed
    print_line(f"{result.image}: the one image, with the hand in it; {result.prediction.touched.sum()} fingers touched")
    print_line(f"{result.mesh}: closed, {0 if closed is None else len(closed.faces)} faces, made in {result.seconds:.0f} s")
    print_line(f"{result.turntable}: the object, and its reconstruction, {1e3 * result.distance:.1f} mm from it on average")


def score(
    folder: Annotated[
        Path, typer.Argument(help="Folder of OBJECT.ply, .obj, .stl, .off, .glb, … or .npy, one per test object: metres, world frame.")
    ],
    data: DataArgument,
    name: Annotated[str | None, typer.Option(help="Name of the method, in tables; by default the folder's.")] = None,
    grasps: Annotated[
        int, typer.Option(min=1, help="Grasps that the files were made from; more in folders grasps-N, or grasps-N-from-K, below.")
    ] = 1,
    misplaced: Annotated[bool, typer.Option(help="Also measure files that are far from their object, or in another unit.")] = False,
) -> None:
    """Measure another method's reconstructions as `evaluate` measures networks.

    Each file that is missing, unreadable or not in the world's frame is named, and then nothing is written.
    """
    from pipeline.tables.evaluation_tables import evaluation_tables
    from stages.evaluate.evaluation_files import METRICS
    from stages.evaluate.scores import score as measure

    directory = DataDirectory(data)
    results = directory.verified_folder(measure(folder, directory.root, console, name=name, grasps=grasps, misplaced=misplaced))
    show_tables(console, evaluation_tables(results))
    shown = f"`vt-pipeline report {shlex.quote(data)}` shows them beside the networks'"
    print_line(f"{results / METRICS}: the means as JSON, with the settings; {shown}")


def _grid(options: list[str]) -> dict[str, list[Any]]:
    grid = {}
    for option in options:
        setting, separator, values = option.partition("=")
        if not separator or not values:
            fail(f"--grid {option}: write SETTING=VALUE,VALUE,…")
        if setting in grid or "." in setting:
            fail(f"--grid {option}: name each setting once, with all its values, and without its stage: SETTING=VALUE,VALUE,…")
        try:
            grid[setting] = yaml.safe_load(values if values.startswith("[") else f"[{values}]")
        except (yaml.YAMLError, ValueError, RecursionError):
            fail(f"--grid {option}: write SETTING=VALUE,VALUE,…")
        if twice := [value for number, value in enumerate(grid[setting]) if value in grid[setting][:number]]:
            fail(f"--grid {option}: {twice[0]} is named twice; name each value once")
    return grid
