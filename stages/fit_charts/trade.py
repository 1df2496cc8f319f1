"""The trade-off of `fit-charts`: the distance of charts from their clouds against the time of fitting."""

from pathlib import Path

from pipeline.dataset.object_rows import ObjectRows
from pipeline.dataset.touch_charts import is_surface
from pipeline.engine.trade import Trade


def residuals(data: Path, reference: Path) -> dict[str, float]:
    """Compute the mean RMS distance from clouds to their charts, um by object."""
    rows = ObjectRows(data, ("residual", "stop_rule"), split=None)
    residual_by_object = {}
    for name in rows.object_ids:
        fitted = is_surface(rows.read("stop_rule", name))
        if fitted.any():
            residual_by_object[name] = 1e6 * float(rows.read("residual", name)[fitted].mean())
    return residual_by_object


TRADE = Trade(
    metric="cloud to chart, mean RMS",
    unit="um",
    candidates=({"halt": 1.2e-3}, {"step_samples": 250}, {"step_samples": 1000}, {"tight": True}),
    errors=residuals,
)
