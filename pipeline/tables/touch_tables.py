"""Statistics of a dataset's grasps, beside Table 1 and section 1.6 of the supplement, of the hold test, of slides and lifts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config.manifest import TOTAL
from pipeline.console import Columns, Row, Table, tabulate
from pipeline.dataset.grasps import grasp_counts
from pipeline.dataset.object_rows import ObjectRows, has_paper_sizes, sensors_of
from pipeline.kernels.touch.depth_maps import beyond_ranges
from pipeline.kernels.touch.lift import rests
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location
from pipeline.tables.supplement_figures import PAPER, TABLE_1, TOUCHES_PER_GRASP
from schemas.catalogue import ARTIFACTS
from schemas.grasps import GRASPS
from schemas.sequences import SEQUENCES
from schemas.touch import TOUCH

CONTACT_ARRAYS = ("contact_area", "opposition", "closure")
HOLD_ARRAYS = ("held", "held_directions", "hold_distance", "hold_speed")
OPPOSED = 90  # degrees between the normals of two contacts, above which they press against each other
SIZES = 5  # maximum number of size bins; each but the last has an equal share of the objects
MIN_RATIO, SAME = 1.05, 1 + 1e-6
"""Least ratio of the lower ends of successive bins; and ratio up to which sizes are equal, as those of objects scaled to one size."""
DIRECTIONS = ("−x", "+x", "−y", "+y", "−z", "+z")  # directions of gravity, as in `held_directions`


@dataclass(frozen=True)
class ObjectTouches:
    """The grasps of one object; None without the hold test that an array is computed from."""

    category: str
    touched: NDArray[np.bool_]  # (grasp, sensor): which touches of the kept grasps succeed
    attempts: NDArray[np.float64]  # (sensor,) share of all attempts in which a sensor touched
    contacts: NDArray[np.float64]  # (grasp, 3) contact area, mm²; greatest angle between contacts, °; margin of closure
    held: NDArray[np.bool_] | None = None  # (grasp,): which grasps hold the object in the hold test
    held_directions: NDArray[np.bool_] | None = None  # (grasp, 6): the same by direction of gravity
    motions: NDArray[np.float64] | None = None  # (grasp, 6, 2) how far, m, and how fast, m/s, the object moved in the end
    diagonal: float = 0.0  # of the bounding box, m
    gels: NDArray[np.float64] | None = None  # (touch, 4): force, N; indentation, mm; whether beyond the elastic layer, and the calibration


def joined(objects: Sequence[ObjectTouches], array: str) -> NDArray[Any]:
    """Concatenate an array of objects; empty if they have none."""
    parts = [part for item in objects if (part := getattr(item, array)) is not None]
    return np.concatenate(parts) if parts else np.zeros(0)


@dataclass(frozen=True)
class Touches:
    """The grasps of a dataset's objects that did not fail, in order of their classes."""

    objects: Sequence[ObjectTouches]
    sensors: Sequence[str]  # their names
    paper: bool  # objects have the paper's sizes: its figures are put beside ours

    @property
    def by_class(self) -> dict[str, list[ObjectTouches]]:
        """The objects of each class."""
        return {name: [item for item in self.objects if item.category == name] for name in dict.fromkeys(o.category for o in self.objects)}

    @property
    def per_grasp(self) -> NDArray[np.float64]:  # (1 + sensor,)
        """The per cent of grasps with 0, 1, … successful touches."""
        touched = joined(self.objects, "touched")
        return np.asarray(100 * np.bincount(touched.sum(axis=1), minlength=touched.shape[1] + 1) / len(touched))

    @property
    def supplement_per_grasp(self) -> tuple[float, ...]:
        """The supplement's figures beside `per_grasp`; empty for other sizes or another number of sensors."""
        return TOUCHES_PER_GRASP if self.paper and len(self.sensors) + 1 == len(TOUCHES_PER_GRASP) else ()


def read_touches(data: Location) -> Touches:
    """Read the touches of a data directory, without grasps that `read-grasps` repeated."""
    grasps = DataDirectory(data).collection(GRASPS)
    shard = grasps.first
    hold = tuple(name for name in HOLD_ARRAYS if shard.has(name))
    rows = ObjectRows(data, ["touch_success", "attempt_success", *CONTACT_ARRAYS, *hold], split=None)
    objects, counts = [], grasp_counts(grasps, rows.object_ids)
    gels = _read_gels(data, counts)
    for object_id, category in zip(rows.object_ids, rows.categories, strict=True):
        kept = {name: rows.read(name, object_id)[: counts[object_id]] for name in ("touch_success", *CONTACT_ARRAYS, *hold)}
        area, angle, margin = (kept[name] for name in CONTACT_ARRAYS)
        contacts = np.stack([1e6 * area.sum(axis=1), angle, margin], axis=1)
        measured: dict[str, Any] = {"gels": gels.get(object_id)}
        measured |= {name: kept[name] for name in ("held", "held_directions") if name in hold}
        if hold:
            measured["diagonal"] = rows.diagonal(object_id)
        if "hold_speed" in hold:
            measured["motions"] = np.stack([kept["hold_distance"], kept["hold_speed"]], axis=-1)
        objects.append(ObjectTouches(category, kept["touch_success"], rows.read("attempt_success", object_id), contacts, **measured))
    sensors = [str(name) for name in shard.read("sensor")]
    return Touches(sorted(objects, key=lambda item: item.category), sensors, has_paper_sizes(data))


def _read_gels(
    data: Location,
    counts: Mapping[str, int],  # of the objects' grasps
) -> dict[str, NDArray[np.float64]]:
    """Read `gels` of the objects whose touches have been simulated, by name; none without elastic gels."""
    collection, gels = DataDirectory(data).collection(TOUCH), {}
    if collection.shards and collection.first.has("indentation"):
        sensors = sensors_of(collection.first)
        for name in (name for name in collection if name in counts and not collection.failure(name)):
            indentation, force = (collection.view(name)[array][: counts[name]] for array in ("indentation", "force"))
            columns = np.stack([force, 1e3 * indentation, *beyond_ranges(indentation, sensors)], axis=-1)
            gels[name] = columns[indentation > 0].astype(np.float64)
    return gels


def touch_tables(touches: Touches) -> list[Table]:
    """Make the tables of touches, contacts and the hold test by class, then of touches per grasp and per sensor."""
    groups = {**touches.by_class, TOTAL: touches.objects}
    columns: Columns = {
        "objects": ("", lambda name: len(groups[name])),
        "grasps": ("", lambda name: len(joined(groups[name], "touched"))),
        "touches": ("", lambda name: joined(groups[name], "touched").size),
        "% successful": (".1f", lambda name: 100 * float(joined(groups[name], "touched").mean())),
        **({f"% in {PAPER}": ("", TABLE_1.get)} if touches.paper else {}),
        "% of attempts, mean over objects": (".1f", lambda name: 100 * float(np.mean([item.attempts for item in groups[name]]))),
    }
    tables = [tabulate("Table 1: touches, all splits", "class", {name: name for name in groups}, columns)]
    contacts: Columns = {
        "area of contact per grasp, mm²": (".0f", lambda objects: joined(objects, "contacts")[:, 0].mean()),
        f"% with contacts over {OPPOSED}° apart": (".1f", lambda objects: 100 * (joined(objects, "contacts")[:, 1] > OPPOSED).mean()),
        "% with force closure": (".1f", lambda objects: 100 * (joined(objects, "contacts")[:, 2] > 0).mean()),
    }
    tables += [tabulate("Contacts", "class", groups, contacts), *gel_tables(touches), *hold_tables(touches)]
    rows = [_percent_row("here", touches.per_grasp)]
    if touches.supplement_per_grasp:
        rows.append(Row([PAPER, None, *_percent_row("", touches.supplement_per_grasp[1:]).cells[1:]]))
    numbers = map(str, range(len(touches.sensors) + 1))
    tables.append(Table("Grasps by their number of successful touches, %", ["touches", *numbers], rows))
    rows = [
        _percent_row("kept", 100 * joined(touches.objects, "touched").mean(axis=0)),
        _percent_row("attempts, mean over objects", 100 * np.mean([item.attempts for item in touches.objects], axis=0)),
    ]
    return [*tables, Table("Successful touches of each sensor, %", ["grasps", *touches.sensors], rows)]


def _percent_row(name: str, shares: Sequence[float] | NDArray[np.float64]) -> Row:
    return Row([name, *(f"{share:.1f}" for share in shares)])


def sequence_tables(data: Location) -> list[Table]:
    """Count slides and lifts and their steps by class, those not settled and those in gross slip, and how lifts end; none if none are."""
    directory, tables = DataDirectory(data), []
    for kind, artifact in SEQUENCES.items():
        collection = directory.collection(ARTIFACTS[artifact])
        names = [f"{kind}_{name}" for name in ("settled", "gross_slip", "held", "imbalance", "weight")]  # slides have the first two
        stored = [name for name in names if collection.shards and collection.first.has(name)]
        if stored:
            rows = ObjectRows(data, stored, split=None)
            counts = grasp_counts(directory.collection(GRASPS), rows.object_ids) if kind == "lift" else {}
            tables.append(_sequence_table(rows, kind, counts))
    return tables


def _sequence_table(rows: ObjectRows, kind: str, lifts: Mapping[str, int]) -> Table:
    groups = dict[str, list[dict[str, NDArray[Any]]]]()  # flags by class and object: (sequence, step), or (sequence,) of its end
    for object_id, category in sorted(zip(rows.object_ids, rows.categories, strict=True), key=lambda item: item[1]):
        row = {name.partition("_")[2]: rows.read(name, object_id)[: lifts.get(object_id)] for name in rows.arrays}
        flags: dict[str, NDArray[Any]] = {name: row[name] for name in ("settled", "gross_slip") if name in row}
        if kind == "lift":  # which have a dimension of sensors
            flags = {name: np.asarray(values.all(axis=1) if name == "settled" else values.any(axis=1)) for name, values in flags.items()}
            flags["rest"] = rests(*(row[name][..., -1] for name in ("held", "imbalance", "weight", "settled")))
            flags["lost"] = ~row["held"][:, -1]
        groups.setdefault(category, []).append(flags)
    groups[TOTAL] = [flags for objects in groups.values() for flags in objects]

    def percent(name: str, objects: Sequence[Mapping[str, NDArray[Any]]]) -> float:
        return 100 * float(np.concatenate([flags[name] for flags in objects]).mean())

    columns: Columns = {
        "objects": ("", len),
        f"{kind}s": ("", lambda objects: sum(len(flags["settled"]) for flags in objects)),
        "steps": ("", lambda objects: sum(flags["settled"].size for flags in objects)),
        "steps not settled": ("", lambda objects: int(sum((~flags["settled"]).sum() for flags in objects))),
    }
    shares = {"gross_slip": "% of steps in gross slip", "rest": "% that end at rest", "lost": "% that slip out"}
    columns |= {label: (".1f", partial(percent, name)) for name, label in shares.items() if name in groups[TOTAL][0]}
    return tabulate(f"{kind.capitalize()}s", "class", groups, columns)


def gel_tables(touches: Touches) -> list[Table]:
    """Tabulate how hard and how deep elastic gels are pressed, by class; none for gels that are not elastic."""
    if not joined(touches.objects, "gels").size:
        return []
    columns: Columns = {
        "touches": ("", lambda objects: len(joined(objects, "gels"))),
        "N, median": (".2f", lambda objects: float(np.median(joined(objects, "gels")[:, 0]))),
        "N, most": (".2f", lambda objects: joined(objects, "gels")[:, 0].max()),
        "mm deep, median": (".2f", lambda objects: float(np.median(joined(objects, "gels")[:, 1]))),
        "mm deep, most": (".2f", lambda objects: joined(objects, "gels")[:, 1].max()),
        "% beyond the layer": (".1f", lambda objects: 100 * joined(objects, "gels")[:, 2].mean()),
        "% beyond the calibration": (".1f", lambda objects: 100 * joined(objects, "gels")[:, 3].mean()),
    }
    groups = {name: objects for name, objects in touches.by_class.items() if joined(objects, "gels").size}
    return [tabulate("Elastic gels", "class", {**groups, TOTAL: touches.objects}, columns)]


def hold_tables(touches: Touches) -> list[Table]:
    """Tabulate which kept grasps hold the object, by class and by the object's size; none for grasps that were not tested."""
    if not joined(touches.objects, "held").size:
        return []
    columns: Columns = {
        "objects": ("", len),
        "grasps": ("", lambda objects: len(joined(objects, "held"))),
        "touches per grasp": (".2f", lambda objects: float(joined(objects, "touched").sum(axis=1).mean())),
        "% that hold": (".1f", lambda objects: 100 * float(joined(objects, "held").mean())),
    }
    if joined(touches.objects, "held_directions").size:
        columns["% in all"] = (".1f", lambda objects: 100 * float(joined(objects, "held_directions").all(axis=1).mean()))
        columns |= {name: (".1f", partial(_percent_held, number)) for number, name in enumerate(DIRECTIONS)}
    by_size: Mapping[str, Sequence[ObjectTouches]] = {
        name: [touches.objects[number] for number in numbers]
        for name, numbers in size_bins(np.array([item.diagonal for item in touches.objects])).items()
    }
    return [
        tabulate("Kept grasps that hold the object, by class", "class", {**touches.by_class, TOTAL: touches.objects}, columns),
        tabulate("The same, by the diagonal of the object's bounding box", "diagonal", by_size, columns),
    ]


def _percent_held(direction: int, objects: Sequence[ObjectTouches]) -> float:
    return 100 * float(joined(objects, "held_directions")[:, direction].mean())


def size_bins(
    diagonals: NDArray[np.float64],  # (N,) m
) -> dict[str, list[int]]:  # object numbers by bin name, from small to large
    """Sort objects into bins of size, whose ends are the data's, by their diagonals."""
    min_count, bins = np.ceil(len(diagonals) / SIZES), list[list[int]]()
    for number in np.argsort(diagonals, kind="stable").tolist():
        size = diagonals[number]
        if bins and (len(bins[-1]) < min_count or size < MIN_RATIO * diagonals[bins[-1][0]] or size <= SAME * diagonals[bins[-1][-1]]):
            bins[-1].append(number)
        else:
            bins.append([number])
    named: dict[str, list[int]] = {}
    for members in bins:
        low, high = (f"{100 * diagonals[number]:.3g}" for number in (members[0], members[-1]))
        named[f"{low} cm" if low == high else f"{low} to {high} cm"] = members
    return named
