"""What `evaluate` writes: one Zarr group per table in `evaluation/tables.zarr`, values per object below `values/CONFIGURATION`."""

from dataclasses import dataclass

from schemas.base import Array

VERSION = 2

Dims = tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """Declare the arrays of one group; those called like a dimension are its coordinates."""

    summary: str
    arrays: dict[str, Array]


def _table(summary: str, **arrays: Array) -> Table:
    return Table(summary, arrays)


def _name(dim: str, description: str) -> Array:
    return Array((dim,), "string", "1", description)


def _count(dims: Dims, description: str) -> Array:
    return Array(dims, "int32", "1", description)


def _squared(dims: Dims, description: str) -> Array:
    return Array(dims, "float64", "m2", description)


def _share(dims: Dims, description: str) -> Array:
    return Array(dims, "float64", "1", description)


def _interval(dims: Dims) -> dict[str, Array]:
    low = "Lower end of the mean's 95 % bootstrap interval over objects; -inf where there is one object."
    high = "Its upper end; +inf where there is one object."
    return {name: Array(dims, "float64", "m2", text, infinite=True) for name, text in (("low", low), ("high", high))}


_OBJECTS = {"object_id": _name("object", "The object's name."), "category": _name("object", "Its class.")}
_CONFIGURATION = _name("configuration", "The trained model.")
_CATEGORY = _name("category", "The class; `all` is every object.")
_GIVEN = _count(("grasps_given",), "How many grasps the model was given.")
_RING = _count(("ring",), "Ring k reaches k / 2 sensor widths to each side of the touch site.")
_BY_RING: Dims = ("configuration", "ring")
_BY_GIVEN: Dims = ("configuration", "grasps_given")
_BY_CATEGORY: Dims = ("configuration", "category")
_CASE: Dims = ("object", "first_grasp", "grasps_given")
_SITE: Dims = ("object", "first_grasp", "sensor", "ring")

QUALITY = {
    "area_ratio": _share(("object",), "Area of the reconstruction over that of the true surface, which is 1 for a smooth one."),
    "dihedral": Array(("object",), "float64", "deg", "Median angle between the normals of neighbouring faces of the vision charts."),
    "seam_gap": Array(("object",), "float64", "m", "Mean distance between vertices of vision charts that were one point of the sphere."),
    "spike": Array(("object",), "float64", "m", "Distance to the true points that 99.9 % of the predicted points stay within."),
    "normal_consistency": _share(("object",), "Mean absolute cosine between normals of nearest points, both directions; 0.5 by chance."),
    "crossing": _share(("object",), "Share of the vision charts' faces that cross another one."),
}
"""How reconstructions look with one grasp, the first one: what Chamfer distance does not see."""

TABLES = {
    "objects": _table(
        "The objects evaluated, and what a perfect reconstruction of each would measure.",
        **_OBJECTS,
        area=_squared(("object",), "Area of its surface as its points show it; sides nearer than neighbouring points count once."),
        floor=_squared(("object",), "Sampling floor of its Chamfer distance, 2 A / (pi n)."),
    ),
    "table_1": _table(
        "Table 1: the dataset, all splits.",
        category=_CATEGORY,
        objects=_count(("category",), "Objects that did not fail."),
        grasps=_count(("category",), "Grasps of them."),
        touches=_count(("category",), "Sensors of these grasps."),
        successful=_share(("category",), "Share of the touches that succeed."),
    ),
    "table_2": _table(
        "Table 2: local Chamfer distance, ground truth to prediction, in square rings around the touch sites of one grasp. "
        "Mean over an object's sites that have points in the ring, then over objects.",
        configuration=_CONFIGURATION,
        ring=_RING,
        local_chamfer=_squared(_BY_RING, "The mean; 0 where `objects` is 0, then it has no value."),
        objects=_count(_BY_RING, "Objects the mean is of."),
        sites=_count(_BY_RING, "Touch sites with points in the ring."),
        **_interval(_BY_RING),
    ),
    "table_3": _table(
        "Table 3: Chamfer distance by the number of grasps given, mean over first grasps, then over objects.",
        configuration=_CONFIGURATION,
        grasps_given=_GIVEN,
        chamfer=_squared(_BY_GIVEN, "The mean."),
        **_interval(_BY_GIVEN),
    ),
    "modalities": _table(
        "Chamfer distance and F1 by configuration and class with one grasp, mean over grasps, then over objects.",
        configuration=_CONFIGURATION,
        category=_CATEGORY,
        objects=_count(("category",), "Objects the means are of."),
        floor=_squared(("category",), "Mean sampling floor of these objects."),
        chamfer=_squared(_BY_CATEGORY, "The mean."),
        **_interval(_BY_CATEGORY),
        tau=_squared(("threshold",), "Squared distance up to which a point counts as matched, the clouds scaled by the setting `scale`."),
        f1=_share((*_BY_CATEGORY, "threshold"), "Mean F1 at the squared distance tau."),
        median=_squared(_BY_CATEGORY, "The median over objects of the Chamfer distance."),
    ),
    "quality": _table(
        "How reconstructions look, by configuration: means and medians over objects, with one grasp.",
        configuration=_CONFIGURATION,
        measure=_name("measure", "One of the arrays of that name in `values`."),
        mean=_share(("configuration", "measure"), "In the unit of the array."),
        median=_share(("configuration", "measure"), "In the unit of the array."),
    ),
    "closed_surfaces": _table(
        "Reconstructions with one grasp as closed meshes, by configuration; only where the setting `closed_resolution` asks for them.",
        configuration=_CONFIGURATION,
        watertight=_share(("configuration",), "Share of the meshes each of whose edges has two faces."),
        objects=_count(("configuration",), "Objects that are watertight, and so have an inside: mean and median are of them."),
        mean=_share(("configuration",), "Mean over objects of the intersection over union; 0 where there is none."),
        median=_share(("configuration",), "Its median."),
    ),
    "baselines": _table(
        "Chamfer distance of training objects that are given in place of a reconstruction: what a network has to beat.",
        baseline=_name("baseline", "How the training object is chosen; see the guide to learning."),
        category=_CATEGORY,
        chamfer=_squared(("baseline", "category"), "The mean over objects."),
        median=_squared(("baseline", "category"), "The median."),
        low=_interval(("baseline", "category"))["low"],
        high=_interval(("baseline", "category"))["high"],
    ),
    "charts": _table(
        "Touch charts of the objects evaluated: how far the fitted charts are from their clouds, by the rule that stopped the fit.",
        stop_rule=_name("stop_rule", "Why the fit stopped; `all` is every chart that was fitted."),
        charts=_count(("stop_rule",), "Charts it stopped."),
        residual_mean=Array(("stop_rule",), "float64", "m", "Mean of their RMS distances."),
        residual_worst=Array(("stop_rule",), "float64", "m", "The largest."),
        iterations=_share(("stop_rule",), "Mean number of iterations."),
    ),
    "training": _table(
        "What the training of each model came to; its seconds and hardware are in the records.",
        configuration=_CONFIGURATION,
        parameters=_count(("configuration",), "Numbers trained."),
        epochs=_count(("configuration",), "Epochs done."),
        best_epoch=_count(("configuration",), "The epoch whose weights were kept."),
        best_loss=_share(("configuration",), "Its validation loss."),
    ),
    "values": _table(
        "One model's figures for every object and choice of grasps. Grasps first_grasp, first_grasp + 1, … are given, around the "
        "end; the occluded image is the first one's. Where the model does not depend on the choice its figure is repeated.",
        **_OBJECTS,
        grasps_given=_GIVEN,
        ring=_RING,
        chamfer=_squared(_CASE, "Chamfer distance: mean squared nearest distance, both directions summed."),
        precision=_share((*_CASE, "threshold"), "Share of predicted points within tau of the truth, 2 tau."),
        recall=_share((*_CASE, "threshold"), "Share of true points within tau of the prediction, 2 tau."),
        f1=_share((*_CASE, "threshold"), "Their harmonic mean."),
        local_chamfer=_squared(_SITE, "Mean squared distance of the true points in a ring to the prediction, given this grasp alone."),
        **QUALITY,
        local_points=_count(_SITE, "True points in the ring around a sensor that touched; where there are none, there is no value."),
    ),
    "closed": _table(
        "One model's reconstructions with one grasp, the first one, as closed meshes.",
        object_id=_OBJECTS["object_id"],
        watertight=Array(("object",), "bool", "1", "Each edge of the mesh has two faces."),
        has_inside=Array(("object",), "bool", "1", "The object's mesh is watertight."),
        iou=_share(("object",), "Volume inside both mesh and object over that inside either; 0 where `has_inside` is false."),
    ),
    "predictions": _table(
        "One model's vision charts for every object and choice of grasps; touch charts are those of the artifact `charts`.",
        object_id=_OBJECTS["object_id"],
        first_grasp=_count(("case",), "The first grasp given."),
        grasps_given=_count(("case",), "How many were given, 0 where the model takes none."),
        vertices=Array(("object", "case", "vertex", "xyz"), "float32", "m", "World frame."),
        faces=Array(("face", "corner"), "int32", "1", "Rows of `vertices`."),
        position=_count(("vertex",), "Vertices with the same number lie on one seam and are one point of the joined surface."),
    ),
    "meshes": _table(
        "One implicit model's closed meshes for every object, with the first grasp and those that follow it; one mesh after the other.",
        object_id=_OBJECTS["object_id"],
        first_grasp=_count(("case",), "The first grasp given."),
        grasps_given=_count(("case",), "How many were given, 0 where the model takes none."),
        vertices=Array(("vertex", "xyz"), "float32", "m", "Of all meshes, case by case of each object; world frame."),
        faces=Array(("face", "corner"), "int32", "1", "Of all meshes likewise: rows of the mesh's own vertices."),
        vertex_count=_count(("object", "case"), "Vertices of each mesh."),
        face_count=_count(("object", "case"), "Faces of each mesh."),
    ),
}
"""Every group by name; `values`, `predictions`, `meshes` and `closed` hold one group per configuration."""
