"""Read slides and lifts as frames, one per step, for every table format; and choose what the frames of an export are."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from pipeline.console import pluralise
from pipeline.contrib.exports.grasp_frames import Column, Frames, GraspFrames
from pipeline.dataset.object_rows import sensors_of
from pipeline.errors import InvalidInput, unknown_name
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location
from schemas.catalogue import ARTIFACTS, artifact_of
from schemas.presses import PRESSED
from schemas.sequences import SEQUENCES, over_time

STEPWISE = tuple(name for name in (array.partition("_")[2] for array in over_time("slide", "step")) if name != "time")


class SequenceFrames(Frames):
    """The steps of a dataset's touches over time as frames, an episode per sequence."""

    by_finger = STEPWISE
    kind: str
    number: str  # dimension that numbers the sequences of an object
    rate: str  # setting
    others: tuple[str, ...]  # arrays beside those of sensors
    of_grasp: tuple[str, ...] = ()  # arrays of `grasps`, the same in all steps

    def __init__(self, data: Location) -> None:
        collection = DataDirectory(data).collection(ARTIFACTS[SEQUENCES[self.kind]])
        shard, prefix = collection.first, f"{self.kind}_"
        names = ("time", *self.others, *(name for name in STEPWISE if shard.has(prefix + name)))
        super().__init__(data, {name: prefix + name for name in names} | {name: name for name in self.of_grasp}, collection)
        sensors = sensors_of(shard)
        self.counts = dict.fromkeys(self.rows.object_ids, self.rows.size(f"{prefix}time", self.number))
        self.hand, self.labels, self.fps = sensors[0].name, {"sensor": (sensors[0].name,)}, float(shard.attributes["settings"][self.rate])
        if self.of_grasp:
            self.counts = self._read_hand(self.rows.collections["grasps"])
        self.summary = pluralise(sum(self.counts.values()), self.kind)
        self.columns[self.number] = Column("int64", meaning=f"Number of the {self.number}.")
        self.columns["step"] = Column("int64", meaning="Number of the step.")
        self._names = self._name_sensors(sensors)
        for name in self.arrays:
            self.columns |= self._describe(name, ("object", self.number, "step", *(("sensor",) if name == "time" else ())))

    def _frames_of(self, object_id: str) -> Iterator[list[dict[str, Any]]]:
        for number in range(self.counts[object_id]):
            whole, steps = {self.number: number, **self._names}, dict[str, np.ndarray]()
            for name, stored in self.arrays.items():
                shard = self.rows.collections[artifact_of(stored).name].shard(object_id)
                dims = self.rows.dims(stored)[2:]
                values = shard.read(stored, (shard.position[object_id], number))
                if "step" not in dims:
                    whole |= self._values(name, values)
                    continue
                steps[name] = np.moveaxis(values, dims.index("step"), 0)
                if name == "time":
                    steps[name] = steps[name].reshape(len(steps[name]), -1)[:, 0]
                elif name in self.by_finger and "sensor" not in dims:
                    steps[name] = steps[name][:, None]
            frames = []
            for step in range(len(steps["time"])):
                parts = [self._values(name, values[step]) for name, values in steps.items()]
                frames.append(whole | {"step": step} | {name: value for part in parts for name, value in part.items()})
            yield frames


class SlideFrames(SequenceFrames):
    """The steps of slides."""

    task, kind, number, rate, others = "slide over", "slide", "slide", "rate", ("shape", "scale", "friction")

    def __init__(self, data: Location) -> None:
        super().__init__(data)
        self.columns["shape"] = Column("string", meaning="What was pressed: a patch of the object, or a shape.")

    def _values(self, name: str, value: np.ndarray) -> dict[str, Any]:
        return {name: PRESSED[int(value)]} if name == "shape" else super()._values(name, value)


class LiftFrames(SequenceFrames):
    """The steps of lifts, with the posture of the grasp, which the fingers leave by what lets their gels press on."""

    task, kind, number, rate = "lift", "lift", "grasp", "lift_rate"
    others, of_grasp = ("weight", "imbalance", "held", "object_pose"), ("hand_pose", "joint_angles")


FRAMES: Mapping[str, Callable[[Location], Frames]] = {"grasps": GraspFrames, "slides": SlideFrames, "lifts": LiftFrames}
"""What frames may be."""


def open_frames(data: Location, of: str | None = None) -> Frames:
    """Open the frames of a dataset: by default its grasps or, where none have been made, its slides."""
    if of is None:
        of = next((name for name in ("grasps", "slides") if DataDirectory(data).collection(ARTIFACTS[name]).shards), "grasps")
    if of not in FRAMES:
        raise InvalidInput(f"--of: {unknown_name('kind of frames', of, FRAMES)}")
    return FRAMES[of](data)
