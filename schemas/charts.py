"""What `fit-charts` writes: a touch chart for every sensor of every grasp."""

from schemas.base import Array, Artifact, coordinates

STOP_RULES = ("no_touch", "threshold", "cap", "too_few_points", "collapsed")
"""Why the fitting of a chart ended; `stop_rule` holds indices into this. A sensor that touched has too few points where the
U-Net sees none; a chart has collapsed when no face has an area any more."""

FITTED = (1, 2)
"""The codes of charts that were fitted to a touch."""

CHARTS = Artifact(
    name="charts",
    order=4,
    version=2,
    summary="A touch chart for every sensor of every grasp, fitted to the points its U-Net sees, or to the true ones.",
    arrays={
        **coordinates("grasp", "sensor"),
        "vertices": Array(
            dims=("object", "grasp", "sensor", "vertex", "xyz"),
            dtype="float32",
            units="m",
            description="Vertices of the chart in the world; the undeformed sensor square where the sensor did not touch.",
        ),
        "residual": Array(
            dims=("object", "grasp", "sensor"),
            dtype="float32",
            units="m",
            description="Root of the mean squared distance of the cloud's points to the chart's surface; 0 where no chart was fitted.",
        ),
        "iterations": Array(
            dims=("object", "grasp", "sensor"), dtype="int32", units="1", description="Steps of Adam; 0 where no chart was fitted."
        ),
        "stop_rule": Array(
            dims=("object", "grasp", "sensor"),
            dtype="uint8",
            units="1",
            description=f"Why fitting stopped: {', '.join(f'{code} {name}' for code, name in enumerate(STOP_RULES))}.",
        ),
        "chart_faces": Array(
            dims=("face", "corner"), dtype="int32", units="1", description="Triangles of every chart, as indices of its vertices."
        ),
    },
)
