"""All that evaluations say, as tables: of each network, of its trainings together, and whether the supplement's orderings hold."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from pipeline.reports.orderings import orderings, show_orderings
from pipeline.reports.training_seeds import show_trainings
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import exists
from stages.evaluate.printed_tables import show, show_training


def trained(directory: DataDirectory, evaluated: Sequence[str]) -> dict[str, str]:
    """Find the models that were trained: the U-Net, and those of the first evaluation; their folders by name."""
    names = ["models/unet", *(directory.folder(evaluated[0]).models if evaluated else ())]
    return {Path(name).name: name for name in names if exists(directory.folder_record(name))}


def show_results(directory: DataDirectory, evaluated: Sequence[str], console: Console) -> None:
    """Print the tables of evaluations, named one per training seed, and how the models were trained."""
    if evaluated:
        folders = [directory.whole_folder(name) for name in evaluated]
        show(folders[0], console)
        show_trainings(folders, console)
        show_orderings(orderings(folders), console)
    if there := trained(directory, evaluated):
        show_training({name: directory.folder(place).facts for name, place in there.items()}, console)
