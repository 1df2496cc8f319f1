"""Schema of evaluations: Zarr groups in `tables.zarr`, the first one a long table of every figure."""

from schemas.base import Array

VERSION = 6


class Group:
    """The arrays of one group; those with the name of a dimension are its coordinates."""

    def __init__(self, summary: str, **arrays: Array) -> None:
        self.summary, self.arrays = summary, arrays


QUALITY = {
    "area_ratio": ("1", "Area of the reconstruction over that of the true surface, which is 1 for a smooth one."),
    "dihedral": ("deg", "Median angle between the normals of neighbouring faces of the vision charts."),
    "seam_gap": ("m", "Mean distance between vertices of vision charts that were one point of the sphere."),
    "spike": ("m", "Distance to the true points that 99.9 % of the predicted points stay within."),
    "normal_consistency": ("1", "Mean absolute cosine between normals of nearest points, both directions; 0.5 by chance."),
    "crossing": ("1", "Share of the vision charts' faces that cross another one."),
}
"""Unit and meaning of the figures of surface quality with one grasp, the first one: Chamfer distance does not measure it."""

METRICS = {
    "mean_distance": ("m", "Mean nearest distance, the mean of both directions'."),
    "f_5mm": ("1", "F-score at 5 mm: harmonic mean of the shares of predicted and of true points within it of the other surface."),
    "f_2mm": ("1", "F-score at 2 mm; as the next three, where not all objects were scaled to 0.5 m."),
    "near_distance": ("m", "Mean distance to the reconstruction of true points within 10 mm of those that the first grasp touched."),
    "hidden_distance": ("m", "Of true points that the camera does not see in the image with the hand in the first grasp."),
    "hidden_near_distance": ("m", "Of those that are both."),
    "f_1percent": ("1", "F-score at 1 % of the object's diagonal."),
    "chamfer": ("m2", "Chamfer distance: mean squared nearest distance, both directions summed."),
    "precision": ("1", "Share of predicted points within the squared distance tau of the truth; `precision_2tau` within twice it."),
    "recall": ("1", "Share of true points within tau of the prediction; `recall_2tau`."),
    "f1": ("1", "Their harmonic mean; `f1_2tau`."),
    "scaled_chamfer": ("1", "Chamfer distance × 1000 in the unit of Table 4, of single images."),
    "local_chamfer_1": ("m2", "Mean squared distance to the prediction of the true points in the first ring around a touch; `_2`, …"),
    **QUALITY,
    "watertight": (
        "1",
        "1 where each edge of the surface, or of a closed mesh of it, has two faces, else 0; none of charts that are not closed.",
    ),
    "iou": (
        "1",
        "Volume inside both this surface and the object over that inside either; 0 of open ones, none of objects without an inside.",
    ),
}
"""Unit and meaning of each metric."""

GROUPS = {
    "figures": Group(
        "Every figure of every reconstruction: of `evaluate`, of `evaluate-single-image` and of `vt-pipeline score`. Networks called "
        "`training object, …` are no networks: a training object stands in place of each reconstruction, what a network has to beat.",
        network=Array("row", "string", "1", "The trained model."),
        object_id=Array("row", "string", "1", "The object's name."),
        first=Array("row", "int32", "1", "The first grasp given, which the occluded image is of; or the view."),
        grasps=Array("row", "int32", "1", "Grasps given: `first`, `first` + 1, …, around the end. A model without touch has 1."),
        metric=Array("row", "string", "1", "; ".join(f"`{name}` ({units}): {text}" for name, (units, text) in METRICS.items())),
        value=Array("row", "float64", "1", "In the unit of the metric. Of a ring there is a row per touch with points in it."),
    ),
    "objects": Group(
        "The objects evaluated, and what a perfect reconstruction of each would measure.",
        object_id=Array("object", "string", "1", "The object's name."),
        category=Array("object", "string", "1", "Its class."),
        diagonal=Array("object", "float64", "m", "Diagonal of its bounding box."),
        area=Array(
            "object", "float64", "m2", "Area of its surface as its points show it; sides nearer than neighbouring points count once."
        ),
        floor=Array("object", "float64", "m2", "Sampling floor of its Chamfer distance, 2 A / (pi n)."),
    ),
    "charts": Group(
        "Touch charts of the objects evaluated: how far the fitted charts are from their clouds, by the rule that stopped the fit.",
        stop_rule=Array("stop_rule", "string", "1", "Why the fit stopped; `all` is every chart that was fitted."),
        charts=Array("stop_rule", "int32", "1", "Charts it stopped."),
        residual_mean=Array("stop_rule", "float64", "m", "Mean of their RMS distances."),
        residual_worst=Array("stop_rule", "float64", "m", "The largest."),
        iterations=Array("stop_rule", "float64", "1", "Mean number of iterations."),
    ),
    "predictions": Group(
        "One model's vision charts for every object and choice of grasps; touch charts are those of the artifact `charts`.",
        object_id=Array("object", "string", "1", "The object's name."),
        first_grasp=Array("case", "int32", "1", "The first grasp given."),
        grasps_given=Array("case", "int32", "1", "How many were given, 0 where the model takes none."),
        vertices=Array("object case vertex xyz", "float32", "m", "World frame."),
        faces=Array("face corner", "int32", "1", "Rows of `vertices`."),
        position=Array("vertex", "int32", "1", "Vertices with the same number lie on one seam and are one point of the joined surface."),
    ),
    "meshes": Group(
        "The meshes of a model that deforms no charts, of every object with the first grasp and those that follow it, mesh by mesh.",
        object_id=Array("object", "string", "1", "The object's name."),
        first_grasp=Array("case", "int32", "1", "The first grasp given."),
        grasps_given=Array("case", "int32", "1", "How many were given, 0 where the model takes none."),
        vertices=Array("vertex xyz", "float32", "m", "Of all meshes, case by case of each object; world frame."),
        faces=Array("face corner", "int32", "1", "Of all meshes likewise: rows of the mesh's own vertices."),
        vertex_count=Array("object case", "int32", "1", "Vertices of each mesh."),
        face_count=Array("object case", "int32", "1", "Faces of each mesh."),
    ),
}
"""Every group by name; `predictions` and `meshes` hold one group per network."""
