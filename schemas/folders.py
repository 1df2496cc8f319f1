"""Folders that dataset stages fill, beside the artifacts: their paths, and the command that makes each."""

import re
import shlex

TREES = ("models", "sweeps", "scores")  # folders that hold records of folders, at any depth
RECORD = re.compile(r"evaluation(-single-image|-seed-\d+)?\.json")  # records of folders beside the artifacts
_MODEL = re.compile(r"models/(?:seed-(\d+)/)?([^/]+)(?:/([^/]+))?")  # training seed, family and network of a model's folder


def maker_of(folder: str, data: object) -> str:
    """Name what makes a folder of a data directory: `models/seed-1/gcn/touch` comes from `train-gcn` with its network and seed.

    It repeats what trainings declare, because a folder that has not been made has no record, and readers cannot import stages.
    """
    if folder.startswith("scores/"):
        return "`vt-pipeline report --shipped`" if folder == "scores/shipped" else "`vt-pipeline score`"
    if not (match := _MODEL.fullmatch(folder)):
        return "the stage that makes it"
    seed, family, network = match.groups()
    stage = f"train-{family}"
    options = [f" --set {stage}.{what}={value}" for what, value in (("configuration", network), ("training_seed", seed)) if value]
    return f"`vt-pipeline run {stage} --data {shlex.quote(str(data))}{''.join(options)}`"
