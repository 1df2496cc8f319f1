"""Read slides as frames, one per step, for every table format; and choose what the frames of an export are."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pipeline.console import pluralise
from pipeline.contrib.exports.grasp_frames import Column, Frames, GraspFrames
from pipeline.dataset.object_rows import sensor_of
from pipeline.errors import InvalidInput, unknown_name
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location
from schemas.catalogue import ARTIFACTS
from schemas.presses import PRESSED
from schemas.sequences import over_time
from schemas.slides import SLIDES

PREFIX = "slide_"
OF_SLIDE = ("scale", "friction")  # the same in all steps
STEPWISE = tuple(name.removeprefix(PREFIX) for name in over_time("slide", "step") if name != "slide_time")


class SlideFrames(Frames):
    """The steps of a dataset's slides as frames, an episode per slide."""

    by_finger = STEPWISE
    task = "slide over"

    def __init__(self, data: Location) -> None:
        slides = DataDirectory(data).collection(SLIDES)
        shard = slides.first
        super().__init__(data, [*OF_SLIDE, "time", *(name for name in STEPWISE if shard.has(PREFIX + name))], slides, PREFIX)
        self.hand = sensor_of(shard).name
        self.labels["sensor"] = (self.hand,)
        self.fps = float(shard.attributes["settings"]["rate"])
        self.columns["slide"] = Column("int64", meaning="Number of the slide.")
        self.columns["step"] = Column("int64", meaning="Number of the step.")
        self.columns[f"sensor.{self.hand}"] = Column("string", meaning="Name of the sensor.")
        self.columns["shape"] = Column("string", meaning="What was pressed: a patch of the object, or a shape.")
        for name in self.arrays:
            self.columns |= self._describe(name, ("object", "slide", "step"))
        self.slides = self.rows.size("slide_time", "slide")
        self.summary = pluralise(self.slides * len(self.rows.object_ids), "slide")

    def _frames_of(self, object_id: str) -> Iterator[list[dict[str, Any]]]:
        shard = self._main.shard(object_id)
        for slide in range(self.slides):
            arrays = {name: shard.read(PREFIX + name, (shard.position[object_id], slide)) for name in ("shape", *self.arrays)}
            common = {"slide": slide, "shape": PRESSED[int(arrays.pop("shape"))], f"sensor.{self.hand}": self.hand}
            common |= {name: float(arrays.pop(name)) for name in OF_SLIDE}
            frames = []
            for step, time in enumerate(arrays.pop("time")):
                values = [self._values(name, array[None, step]) for name, array in arrays.items()]
                parts = {name: value for part in values for name, value in part.items()}
                frames.append(common | {"step": step, "time": float(time)} | parts)
            yield frames


FRAMES: Mapping[str, Callable[[Location], Frames]] = {"grasps": GraspFrames, "slides": SlideFrames}  # what frames may be, by artifact


def open_frames(data: Location, of: str | None = None) -> Frames:
    """Open the frames of an artifact; by default the first of `FRAMES` that has been made."""
    if of is None:
        of = next((name for name in FRAMES if DataDirectory(data).collection(ARTIFACTS[name]).shards), "grasps")
    if of not in FRAMES:
        raise InvalidInput(f"--of: {unknown_name('artifact', of, FRAMES)}")
    return FRAMES[of](data)
