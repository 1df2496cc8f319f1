"""Summarise the results in a few sentences and one plot: the error by inputs, and that of retrieval."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.console import pluralise
from pipeline.kernels.metrics.bootstrap import Interval, mean_interval
from pipeline.kernels.networks.network_configurations import INPUT_CHOICES
from pipeline.rng import numpy_rng
from pipeline.tables.comparison import comparable_figures
from stages.evaluate.baselines import retrieved_by
from stages.evaluate.evaluation_files import Figures, read_root, read_table

GIVEN = {
    "none": "nothing",
    "touch": "touch",
    "occluded": "occluded\nimage",
    "occluded-touch": "occluded,\ntouch",
    "unoccluded": "whole\nimage",
    "unoccluded-touch": "whole,\ntouch",
}
"""What networks are given, as the plot calls it, by the way of `INPUT_CHOICES`."""
COMPARED_WAYS = {
    "touch": "touch alone",
    "occluded-touch": "an image that the hand occludes and touch",
    "unoccluded": "an image of the whole object",
}
"""Inputs that the sentences compare, in words."""
DEFAULT_SERIES = "graph network"
"""Series of the networks that are named after their inputs."""


@dataclass(frozen=True)
class Summary:
    """The results with one grasp."""

    sentences: list[str]  # three, for the report
    errors: Mapping[str, Mapping[str, Interval]]  # mean distances, mm, by series and by way of `INPUT_CHOICES`
    retrieved: Mapping[str, float]  # mean distance of a training object, mm, by way


def summarise(folder: Path, scored: Sequence[Path], further: Sequence[Path] = ()) -> Summary | None:
    """Summarise the results with one grasp of an evaluation or a score; None if there are none.

    `further` are evaluations of other trainings of its networks, `scored` scores of other methods.
    """
    network_inputs, figures, _ = comparable_figures(folder, scored)
    root = read_root(folder)
    seed, objects = root["seed"], len(read_table(folder, "objects")["object_id"])
    trainings = {name: [figures[name]] for name in network_inputs}
    for training in further:
        further_figures = comparable_figures(training, scored)[1]  # of the same grasps
        for name in trainings.keys() & read_root(training)["configurations"].keys():
            trainings[name].append(further_figures[name])
    errors: dict[str, dict[str, Interval]] = {}
    own = () if "method" in root["settings"] else root["configurations"]
    methods = {read_root(other)["settings"].get("method") for other in (folder, *scored)} - set(own)
    for name, way in _ways(network_inputs).items():
        if name in methods and name == way:  # it would be taken for a graph network
            continue
        if all(1 in network.grasps for network in trainings[name]):
            series = name.removesuffix(way).rstrip("-") or DEFAULT_SERIES
            values = 1e3 * np.stack([network.per_object("mean_distance") for network in trainings[name]])
            errors.setdefault(series, {})[way] = mean_interval(values, numpy_rng(seed, "intervals"))
    if not errors:
        return None
    ways = [way for way in INPUT_CHOICES if any(way in of_series for of_series in errors.values())]
    retrieved = {way: error for way in ways if (error := _retrieved(figures, way)) is not None}
    return Summary(_sentences(errors, retrieved, objects, root["training_objects"]), errors, retrieved)


def _ways(network_inputs: Mapping[str, Any]) -> dict[str, str]:
    """Find the way of `INPUT_CHOICES` that ends each network's name and is its input; skip other networks."""
    ways = {}
    for name, inputs in network_inputs.items():
        way = max((way for way in INPUT_CHOICES if f"-{name}".endswith(f"-{way}")), key=len, default=None)
        if way and (INPUT_CHOICES[way].image, INPUT_CHOICES[way].touch) == (inputs["image"], inputs["touch"]):
            ways[name] = way
    return ways


def _retrieved(figures: Mapping[str, Figures], way: str) -> float | None:
    baseline = figures.get(retrieved_by(INPUT_CHOICES[way].image, INPUT_CHOICES[way].touch))
    return None if baseline is None else 1e3 * float(baseline.per_object("mean_distance").mean())


def _sentences(
    errors: Mapping[str, Mapping[str, Interval]], retrieved: Mapping[str, float], objects: int, training_objects: int
) -> list[str]:
    best: dict[str, tuple[Interval, str]] = {}
    for series, of_series in errors.items():
        for way, error in of_series.items():
            if way not in best or error.mean < best[way][0].mean:
                best[way] = error, series
    phrases = [f"{best[way][0].mean:.1f} mm with {words} ({best[way][1]})" for way, words in COMPARED_WAYS.items() if way in best]
    nearer = [
        (series, way) for series, of_series in errors.items() for way, error in of_series.items() if error.mean < retrieved.get(way, 0)
    ]
    compared = sum(way in retrieved for of_series in errors.values() for way in of_series)
    verb = "is" if 1 in (len(nearer), compared) else "are"
    return [
        f"Networks reconstructed {pluralise(objects, 'test object')} from one grasp each; the error is the mean distance between "
        "reconstruction and object.",
        f"The best are off by {_listed(phrases)}." if phrases else "The plot shows them by what they were given.",
        f"{len(nearer)} of {pluralise(compared, 'network')} {verb} nearer than one of "
        f"{pluralise(training_objects, 'training object')}, which the line shows: the most similar one by the silhouette without the "
        "hand, or else by the touches of the first grasp."
        if retrieved
        else "There is no training object to compare with.",
    ]


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
