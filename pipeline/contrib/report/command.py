"""`vt-pipeline report`: print the tables of evaluations, and write pages of a dataset and its reconstructions."""

from typing import Annotated

import typer

from pipeline.console import console, print_lines, show_tables
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import exists
from pipeline.store.validate import check_origins
from schemas.grasps import GRASPS

SINGLE = "evaluation-single-image"


def report(
    data: Annotated[str, typer.Argument(help="Data directory, or s3://BUCKET/PREFIX.")],
    most: Annotated[int, typer.Option(min=1, help="Objects in a figure of reconstructions at most: best, middling, worst.")] = 10,
    pages: Annotated[bool, typer.Option(help="Write the pages; else print the tables alone.")] = True,
    shipped: Annotated[bool, typer.Option("--shipped", help="Measure the pretrained network for the objects' size too.")] = False,
) -> None:
    """Print the evaluation's tables, and write pages to DATA/report.

    The tables show whether the supplement's orderings hold; the pages have a gallery and figures.
    """
    from pipeline.contrib.report.html_report import write_report
    from pipeline.contrib.report.report_source import ReportSource
    from pipeline.contrib.report.results import Results, training_table
    from pipeline.tables.comparison import scores
    from pipeline.tables.evaluation_tables import evaluation_tables
    from stages.evaluate.evaluation_files import evaluations

    directory = DataDirectory(data)
    if shipped:
        from stages.evaluate.scores import score_shipped

        for reason in score_shipped(directory.root, console):
            print_lines(f"the pretrained network is not measured: {reason}")
    evaluated, outdated = evaluations(directory), scores(directory)
    scored = [name for name, problem in outdated.items() if problem is None]
    for name, problem in outdated.items():
        if problem:
            print_lines(f"{name} is outdated: {problem}")
    if exists(directory.folder_record(SINGLE)):
        check_origins(directory, [SINGLE])
        trainings = training_table(directory, {"single-image": "models/single-image"})
        show_tables([*evaluation_tables(directory.verified_folder(SINGLE)), trainings])
        if not (evaluated or scored or directory.collection(GRASPS).shards):  # single images alone have no pages
            return
    results = Results(directory, evaluated, scored)
    if evaluated or scored:
        show_tables(results.tables)
    if pages:
        print_lines(f"report: {write_report(ReportSource(directory.root, results), console, most)}")
    if not (evaluated or scored):
        note = ": the report shows the dataset alone" if pages else ""
        print_lines(f"no network has been evaluated on the grasps{note}; `make report`, with the same variables, trains some")
