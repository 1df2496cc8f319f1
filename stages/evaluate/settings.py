"""The settings of `evaluate` and `evaluate-single-image`."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from pipeline.config.settings import Settings, setting
from pipeline.errors import unknown_name
from pipeline.models.families import GRASP_CONFIGURATIONS, ROWS

METHOD_NAME = r"^[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}$"
"""Pattern of a method's name, which becomes the name of a folder."""

SHIPPED_SCORES = "scores/shipped"
"""Folder of the figures of the network that ships, below a data directory."""
SHIPPED_ROWS = "shipped-"
"""Prefix of the names of its rows in tables: `shipped-touch` takes touches."""


def _with_one(grasps: tuple[int, ...]) -> tuple[int, ...]:
    if 1 not in grasps or len(set(grasps)) < len(grasps):
        raise ValueError(f"{grasps}: every number once, and 1 among them, for modalities and rings are measured with one grasp")
    return tuple(sorted(grasps))


def _known(names: tuple[str, ...]) -> tuple[str, ...]:
    known = [*GRASP_CONFIGURATIONS, *ROWS]
    if strange := [name for name in names if name not in known]:
        raise ValueError(unknown_name("configuration", strange[0], known))
    # a network that takes any inputs is evaluated in every way
    rows = [row for name in names for row in ([row for row, (network, _) in ROWS.items() if network == name] or [name])]
    if not rows or len(set(rows)) < len(rows):
        raise ValueError(f"{names}: name some of {', '.join(known)}, each once")
    return tuple(rows)


class MeasuringSettings(Settings):
    """The settings of a measurement of networks by any protocol."""

    points: int = setting(10_000, "points drawn from each surface: as many as S^obj has; the sampling floor falls with them", ge=2)
    tau: float = setting(1e-4, "squared distance of F1 in Table 4's protocol, in its scaled unit", gt=0, le=1e6, changes="definition")
    looked_up: int = setting(
        200,
        "training objects of which the baselines' typical one is one, spread evenly: each is compared with each; the others look at all",
        ge=1,
    )
    batch_size: int = setting(16, "as in training; more needs more memory, and sums may differ in their last bit with it", ge=1)
    threads: int = setting(1, "of torch on a CPU, as in training", ge=1)
    accelerator: Literal["auto", "cpu", "cuda"] = setting("auto", "a GPU where there is one", changes="speed")


class GraspMeasuringSettings(MeasuringSettings):
    """Choose what is measured of surfaces that were made from grasps (supplement 3.5, Tables 2 to 4)."""

    grasps: Annotated[tuple[Annotated[int, Field(ge=1)], ...], AfterValidator(_with_one)] = setting(
        (1, 2, 3, 4, 5), "Table 3's numbers of grasps; those the dataset does not have are left out, and named", changes="definition"
    )
    scale: float = setting(
        1.14,
        "Table 4's protocol takes objects of diagonal 1 times 0.57; here their diagonal is 0.5 m, so tau means the same",
        gt=0,
        le=1e6,
        changes="definition",
    )
    rings: int = setting(5, "Table 2's rings, one sensor width after the other", ge=1, changes="definition")
    closed_resolution: int | None = setting(
        None,
        "edges along the longest side of a closed mesh of each object's reconstruction with one grasp, for its watertightness and "
        "intersection over union; null measures those of networks that make closed meshes, as they are; docs/guide/learning.md has "
        "the times; fewer edges than 64 would swell thin bodies",
        ge=64,
        le=400,
    )


class EvaluationSettings(GraspMeasuringSettings):
    """Choose which networks are measured."""

    configurations: Annotated[tuple[str, ...], AfterValidator(_known)] = setting(
        ("none", "touch", "occluded", "occluded-touch", "unoccluded", "unoccluded-touch"),
        "the supplement's five modalities and no input at all; what none of these is shown need not have been made",
        changes="definition",
    )
    training_seed: int = setting(0, "whose networks are evaluated: those of the trainings with this setting", ge=0, changes="definition")


class ScoreSettings(GraspMeasuringSettings):
    """Choose which files `vt-pipeline score` measures, and how; these settings are the command's."""

    method: str = setting(..., "name of the method, in tables", changes="definition", pattern=METHOD_NAME)
    files: str = setting(..., "SHA-256 of all files of the folder, with their names", changes="definition")
    given: int = setting(1, "grasps that the files in the folder itself were made from", ge=1, changes="definition")
    misplaced: bool = setting(False, "whether reconstructions that are far from their objects are measured too", changes="definition")


class ShippedSettings(GraspMeasuringSettings):
    """Choose what the network that ships is given; these settings are those of `vt-pipeline report --shipped`."""

    configurations: tuple[str, ...] = setting(..., "what it is given: rows of the tables", changes="definition")
    weights: str = setting(..., "SHA-256 of the record of the weights", changes="definition")
    learned_from: tuple[str, ...] = setting((), "test objects that it has learned from", changes="definition")


class SingleImageEvaluationSettings(MeasuringSettings):
    """Table 4's standard, and how many views of each object are measured (supplement 3.6)."""

    views: int = setting(
        5,
        "views per test object, the first ones, and per training object that is looked up; the cited evaluations take all 24",
        ge=1,
        changes="definition",
    )
    scale: float = setting(
        0.57, "what objects whose bounding box has diagonal 1 are multiplied by, the standard's", gt=0, le=1e6, changes="definition"
    )
