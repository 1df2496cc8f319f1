"""The settings of `evaluate-single-image`."""

from pipeline.config.settings import Settings, setting


class SingleImageEvaluationSettings(Settings):
    """Table 4's standard, and how many views of each object are measured (supplement 3.6)."""

    views: int = setting(5, "views per test object, the first ones; the cited evaluations take all 24", ge=1, changes="definition")
    points: int = setting(10_000, "points drawn from each surface, the standard's; no more than sample-surfaces.points", ge=2)
    scale: float = setting(
        0.57, "what objects whose bounding box has diagonal 1 are multiplied by, the standard's", gt=0, le=1e6, changes="definition"
    )
    tau: float = setting(
        1e-4, "squared distance of F1 in the scaled unit, the standard's; at twice it too", gt=0, le=1e6, changes="definition"
    )
    looked_up: int = setting(200, "training objects among which the baselines look, spread evenly, of each the first `views`", ge=1)
    batch_size: int = setting(16, "more needs more memory, and sums may differ in their last bit with it", ge=1)
    threads: int = setting(1, "of torch on a CPU, as in training", ge=1)
    accelerator: str = setting("auto", "a GPU where there is one", changes="speed")
