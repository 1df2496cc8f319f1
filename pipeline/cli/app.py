"""Every command of `vt-pipeline`, in the order in which help lists them."""

from __future__ import annotations

import typer

from pipeline.cli import advise, calibrate, check, export, inspection, learn, run, submit
from pipeline.cli.failures import failures_as_words

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_show_locals=False,
    help="Make a visuotactile dataset stage by stage, learn from it, and use what was learned.",
)
for command in (
    run.run,
    submit.submit,
    advise.advise,
    learn.sweep,
    learn.report,
    learn.predict,
    check.check,
    calibrate.calibrate_sensor,
    export.view,
    export.export,
    inspection.stages,
    inspection.status,
    inspection.reshard,
    inspection.collect_garbage,
    inspection.validate,
    inspection.doctor,
    inspection.summary,
):
    app.command()(failures_as_words()(command))
