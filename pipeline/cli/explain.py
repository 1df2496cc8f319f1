"""`vt-pipeline run STAGE --explain`: what was modelled, what was left out and why, and the error measured at these settings."""

from __future__ import annotations

from typing import Any

from pipeline.console import console, say
from pipeline.engine.plan import Plan, Request
from pipeline.engine.stage import SetStage
from pipeline.tuning import explain
from pipeline.tuning.quote import quote


def explain_shard(plan: Plan) -> None:
    """Explain a shard that has just been made, or was up to date."""
    explanation = explain.explain_shard(plan)
    if explanation is not None:
        _show(explanation, plan.request)
    elif plan.request.only is None:  # else it is in another shard, or failed, and that has been said
        say(f"{plan.request.stage.name} {plan.path}: {'every object failed' if plan.jobs else 'no objects'}, there is nothing to explain")


def explain_folder(request: Request[SetStage]) -> None:
    """Explain a folder that a dataset stage has just filled, or that was up to date."""
    _show(explain.explain_folder(request), request)


def _show(explanation: explain.Explanation, request: Request[Any]) -> None:
    say(explanation.title)
    console.print(explanation.table())
    if known := quote(request.stage.name, request.settings):
        say(f"error, {known}")
