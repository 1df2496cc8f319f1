"""Schema of `charts`, from `fit-charts`: a touch chart for every sensor of every grasp."""

from schemas.base import Array, Artifact, coordinates

STOP_RULES = ("no_touch", "threshold", "cap", "too_few_points", "collapsed")
"""Reasons why the fitting of a chart ended; `stop_rule` holds indices into this. A sensor that touched has too few points where the
U-Net sees none; a chart has collapsed when no face has an area any more."""

FITTED = (1, 2)
"""The codes of charts that were fitted to a touch."""

CHARTS = Artifact(
    name="charts",
    stage="fit-charts",
    order=4,
    version=3,
    summary="A touch chart for every sensor of every grasp, fitted to the points its U-Net sees, or to the true ones.",
    arrays={
        **coordinates("grasp", "sensor"),
        "vertices": Array(
            "object grasp sensor vertex xyz",
            "float32",
            "m",
            "Vertices of the chart in the world; the undeformed sensor square where the sensor did not touch.",
        ),
        "residual": Array(
            "object grasp sensor",
            "float32",
            "m",
            "Root of the mean squared distance of the cloud's points to the chart's surface; 0 where no chart was fitted.",
        ),
        "iterations": Array("object grasp sensor", "int32", "1", "Steps of Adam; 0 where no chart was fitted."),
        "stop_rule": Array(
            "object grasp sensor",
            "uint8",
            "1",
            f"Why fitting stopped: {', '.join(f'{code} {name}' for code, name in enumerate(STOP_RULES))}.",
        ),
        "chart_faces": Array("face corner", "int32", "1", "Triangles of every chart, as indices of its vertices."),
    },
)
