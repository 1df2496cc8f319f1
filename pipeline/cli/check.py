"""`vt-pipeline check`: describe a description file and list its faults."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.completion import complete_described
from pipeline.cli.request import ObjectsOption, UnitsOption, UpOption
from pipeline.console import print_line


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
        str | None, typer.Option(help="Folder of trained models, to check an observation against one; by default those that ship.")
    ] = None,
    configuration: Annotated[
        str | None, typer.Option(help="Which model of MODELS; by default occluded-touch, of shipped ones implicit-any.")
    ] = None,
    objects: ObjectsOption = None,
    units: UnitsOption = None,
    up: UpOption = None,
) -> None:
    """Check and draw a hand, sensor, scene, manifest or observation file.

    All faults are named at once; with one, the exit status is 1. A manifest's objects are all read: sizes, units, faces, textures. An
    observation is checked as `predict` does before it runs.
    """
    from pipeline.checks.description_checks import check_file, is_observation
    from pipeline.checks.manifest_check import MeshFiles

    inputs = None
    if models is not None or configuration is not None or is_observation(file):
        from pipeline.models.shipped_weights import models_place
        from pipeline.reconstruct.predict import chosen_models, model_reader

        inputs = model_reader(*chosen_models(None if models is None else models_place(models), None, configuration)).inputs
    meshes = None if objects is None and units is None and up is None else MeshFiles(objects, units, up)
    lines = check_file(file, picture, inputs, meshes)
    for line in lines:
        print_line(line)
    if any(line.startswith("fault:") for line in lines):
        raise typer.Exit(1)
