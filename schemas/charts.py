"""Schema of `charts`, from `fit-charts`: a touch chart for every sensor of every grasp."""

from enum import IntEnum

from schemas.base import Array, Artifact, coordinates


class StopRule(IntEnum):
    """Why the fit of a chart ended."""

    no_touch = 0
    threshold = 1
    cap = 2
    too_few_points = 3  # the U-Net sees none where the sensor touched
    collapsed = 4  # no face has an area any more


FITTED = (StopRule.threshold, StopRule.cap)  # rules of charts that were fitted to a touch

CHARTS = Artifact(
    name="charts",
    stage="fit-charts",
    order=4,
    version=3,
    summary="A touch chart for every sensor of every grasp, fitted to the points its U-Net sees, or to the true ones.",
    arrays={
        **coordinates("grasp", "sensor"),
        "vertices": Array("object grasp sensor vertex xyz", "float32", "m", "In the world; the undeformed sensor square without a touch."),
        "residual": Array("object grasp sensor", "float32", "m", "RMS distance of the cloud's points to the chart; 0 without a chart."),
        "iterations": Array("object grasp sensor", "int32", "1", "Steps of Adam; 0 where no chart was fitted."),
        "stop_rule": Array("object grasp sensor", "uint8", "1", f"Stopped by {', '.join(f'{rule:d} {rule.name}' for rule in StopRule)}."),
        "chart_faces": Array("face corner", "int32", "1", "Triangles of every chart, as indices of its vertices."),
    },
)
