"""Every command of `vt-pipeline`, by the panels in which help lists them."""

from collections.abc import Callable
from importlib.metadata import version
from typing import Annotated

import typer

from pipeline.cli import advise, calibrate, check, export, inspection, learn, read, recipe, run, submit, tradeoff
from pipeline.cli.failures import CONTINUE_HINT, REPEAT_HINT, report_failures

PANELS: dict[str, tuple[Callable[..., None], ...]] = {
    "Make": (run.run, submit.submit, recipe.remake, tradeoff.tradeoff, advise.advise),
    "Learn": (learn.sweep, learn.report, learn.predict, learn.demo, learn.score, read.read_touch),
    "Describe": (check.check, calibrate.calibrate_sensor, inspection.stages),
    "Look and export": (inspection.status, inspection.summary, export.export, recipe.recipe),
    "Maintain": (inspection.validate, inspection.reshard, inspection.collect_garbage, inspection.doctor),
}

CONTINUED = (run.run, submit.submit, recipe.remake, tradeoff.tradeoff, learn.sweep, learn.report, export.export, inspection.reshard)
"""Commands that keep what they made when they are stopped, and continue from there."""

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_show_locals=False,
)
for panel, commands in PANELS.items():
    for command in commands:
        app.command(rich_help_panel=panel)(report_failures(CONTINUE_HINT if command in CONTINUED else REPEAT_HINT)(command))


def _print_version(requested: bool) -> None:
    if requested:
        typer.echo(f"vt-pipeline {version('vt-pipeline')}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")] = False,
) -> None:
    """Make a visuotactile dataset stage by stage, learn from it, and use what was learned."""
