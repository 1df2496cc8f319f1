"""`vt-pipeline run STAGE --explain`: what was modelled, what was left out and why, and the error measured at these settings."""

from __future__ import annotations

from pipeline.console import console, say
from pipeline.engine.folder_plan import FolderPlan
from pipeline.engine.shard_plan import ShardPlan
from pipeline.tuning.explain import explain
from pipeline.tuning.quote import quote


def explain_plan(plan: ShardPlan | FolderPlan) -> None:
    """Explain what has just been made, or was up to date."""
    explanation, request = explain(plan), plan.request
    if explanation is not None:
        say(explanation.title)
        console.print(explanation.table())
        if known := quote(plan.stage.name, request.settings):
            say(f"error, {known}")
    elif request.only is None:  # else it is in another shard, or failed, and that has been said
        say(f"{plan.stage.name} {plan.path}: {'every object failed' if plan.total else 'no objects'}, there is nothing to explain")
