"""`vt-pipeline check`: describe a description file and list its faults."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.completion import complete_described
from pipeline.cli.request import ObjectsOption, UnitsOption, UpOption
from pipeline.console import print_line
from pipeline.errors import InvalidInput


def check(
    file: Annotated[
        str,
        typer.Argument(
            help="A hand, sensor, scene, manifest or observation file, or the name of a shipped one.",
            autocompletion=complete_described("hand", "sensor", "scene", "manifest"),
        ),
    ],
    picture: Annotated[Path | None, typer.Option(help="PNG to draw it in; by default NAME.png in the current folder.")] = None,
    models: Annotated[
        str | None, typer.Option(help="Folder of trained models, to check an observation against one; by default the pretrained ones.")
    ] = None,
    configuration: Annotated[
        str | None, typer.Option(help="Which model of MODELS; by default occluded-touch, of pretrained ones implicit-any.")
    ] = None,
    objects: ObjectsOption = None,
    units: UnitsOption = None,
    up: UpOption = None,
) -> None:
    """Check and draw a hand, sensor, scene, manifest or observation file.

    All faults are named at once; with one, the exit status is 1. A manifest's objects are all read: sizes, units, faces, textures. An
    observation is checked as `predict` does before it runs.
    """
    from pipeline.checks.description_checks import check_file, described_file
    from pipeline.checks.manifest_check import MeshFiles

    path, kind, drawing = described_file(file, picture)
    meshes = None if objects is None and units is None and up is None else MeshFiles(objects, units, up)
    if kind == "observation" and meshes is None:
        from pipeline.models.shipped_weights import models_place
        from pipeline.reconstruct.observation_picture import draw_observation
        from pipeline.reconstruct.predict import PredictOptions

        options = PredictOptions(None if models is None else models_place(models), configuration)
        lines = draw_observation(path, drawing, options.reader().target)
    elif models is not None or configuration is not None:
        option = f"--models {models}" if configuration is None else f"--configuration {configuration}"
        raise InvalidInput(f"{path} is a {kind} file; only an observation is checked against models: leave out {option}")
    else:
        lines = check_file(file, picture, meshes)
    for line in lines:
        print_line(line)
    if any(line.startswith("fault:") for line in lines):
        raise typer.Exit(1)
