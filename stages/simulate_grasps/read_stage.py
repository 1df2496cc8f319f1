"""`read-grasps`: grasps made elsewhere, in place of those that `simulate-grasps` searches."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from itertools import islice
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import field_validator

from pipeline.config.settings import defining, setting
from pipeline.config.sources import Object
from pipeline.console import abbreviate, pluralise
from pipeline.engine.stage import Cost, Inputs, Unit
from pipeline.errors import InvalidInput
from pipeline.formats.file_content import expanded
from pipeline.formats.grasp_file import Stated, grasp_files, read_grasp_file
from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.model import Hand
from pipeline.store.rows import Row
from pipeline.store.shard import Shard
from stages.simulate_grasps.stage import GraspStage, HandSettings


class ReadSettings(HandSettings):
    """Which grasps are read, and how their hand is related to that of the hand file."""

    stage: ClassVar[str] = "read-grasps"

    folder: str | None = setting(
        None, "of grasps: OBJECT.npz, .npy, or a folder OBJECT, of each object; its path changes nothing, its files do", changes="speed"
    )
    grasps: int = defining(
        20,
        "per object, the first that can be used; DexGraspBench and BODex write 20. Where an object has fewer, they are repeated: "
        "learning sees them again, exports and GraspDataset do not",
        ge=1,
    )
    joints: tuple[str, ...] | dict[str, str] = defining(
        (),
        "names of the joints whose values files list without names, in their order, by default that of the hand's model; or {name in "
        "files: name in the model} where files name joints otherwise",
    )
    root: tuple[float, float, float, float, float, float, float] = defining(
        (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
        "the hand's root link in the frame whose pose files state: position, m, and quaternion, real part first; they may have a model of "
        "the same hand with another root",
    )
    close: bool = defining(
        False, "close fingers from the pre-grasp to `squeeze` beyond the grasp until contact rests, instead of taking angles as they are"
    )
    penetration_limit: float = defining(0.01, "m that a rigid link may penetrate the object; DexGraspBench tests none that is deeper", ge=0)

    @field_validator("root")
    @classmethod
    def _turns(cls, root: tuple[float, ...]) -> tuple[float, ...]:
        if not (np.isfinite(root).all() and any(root[3:])):
            raise ValueError(f"{root} is no position and quaternion; the quaternion, its real part first, must not be 0")
        return root


class ReadGrasps(GraspStage):
    """From files of grasps to the poses of the hand and its sensors around each object."""

    name = "read-grasps"
    summary = "Read grasps made elsewhere, in place of simulate-grasps; record which sensors touch."
    settings_type = ReadSettings

    def files(self, settings: ReadSettings, item: Object) -> list[Path]:
        """List the object's files of grasps."""
        return grasp_files(expanded(settings.folder), item.object_id) if settings.folder else []

    def describe_objects(self, settings: ReadSettings, objects: Sequence[Object]) -> Iterator[str]:
        """Name the objects without grasps, and the grasps without an object."""
        folder = grasp_folder(settings)
        names = {item.object_id for item in objects}
        if lacking := sorted(name for name in names if not grasp_files(folder, name)):
            yield f"warning: {pluralise(len(lacking))} without grasps below {folder} ({abbreviate(lacking)})"
        heads = {name[:dash] for name in names for dash, sign in enumerate(name) if sign == "-"} | names
        entries = [path for path in folder.iterdir() if path.is_dir() or path.suffix in (".npz", ".npy")]
        if strange := sorted(path.name for path in entries if (path.name if path.is_dir() else path.stem) not in heads):
            yield f"warning: grasps whose object is not in the manifest ({abbreviate(strange)}): rename their files, or add the object"

    def describe_shard(self, settings: ReadSettings, shard: Shard) -> Iterator[str]:
        """Count the grasps that were read, and say why others were not."""
        read, refused = (
            {name: str(values[row]).splitlines() for name, row in shard.position.items() if values[row]}
            for values in (shard.read("grasp_files"), shard.read("refused_grasps"))
        )
        counts, refusals = [len(lines) for lines in read.values()], sum(map(len, refused.values()))
        further = int(shard.read("attempts").sum()) - sum(counts) - refusals
        total = f"{pluralise(sum(counts), 'grasp')} of {pluralise(len(read))} read, {refusals} refused"
        yield total + (f", {further} further not read: read-grasps.grasps is {settings.grasps}" if further else "")
        if refused:
            reason = next(iter(refused.values()))[0]
            yield f"warning: grasps of {pluralise(len(refused))} refused ({abbreviate([*refused])}; all in `refused_grasps`), {reason}"
        touches = np.max(shard.read("touch_success"), axis=-1)  # (object, grasp)
        untouched = sum(int(np.sum(~touches[shard.position[name], : len(lines)])) for name, lines in read.items())
        if untouched > sum(counts) / 2:
            yield (
                f"warning: {untouched} of {pluralise(sum(counts), 'grasp')} touch with no sensor: are poses in the frame and unit of the "
                "object's file, and is read-grasps.root right for this hand?"
            )
        if counts and max(counts) < settings.grasps:
            yield f"no object has more than {pluralise(max(counts), 'grasp')}: read-grasps.grasps={max(counts)} repeats fewer"

    def describe_misfits(self, settings: ReadSettings, objects: Iterable[tuple[str, Inputs]]) -> Iterator[str]:
        """Name what is estimated of the hand, and the order of the joints in files that do not name them."""
        yield from self.hand_notes(settings)
        for name, _ in () if settings.joints else islice(objects, 1):
            files = grasp_files(grasp_folder(settings), name)[:1]
            stated = [grasp.stated for file in files for grasp in read_grasp_file(file, grasp_folder(settings))]
            if any(isinstance(entry, Stated) and not entry.joints for entry in stated):
                yield f"files do not name joints: read as {', '.join(model_joints(load_hand(settings.hand)))} (read-grasps.joints)"

    def cost(self, settings: ReadSettings) -> Cost:
        """Estimate reading and measuring, a test per grasp, and closing."""
        test = {"none": 0.0, "lift": 0.06, "six": 0.3}[settings.test]
        return Cost(seconds=0.3 + settings.grasps * (0.01 + test + 0.05 * settings.close), kilobytes=settings.grasps)

    def session(self, settings: ReadSettings, models: Mapping[str, Path]) -> AbstractContextManager[Callable[[Unit, Inputs], Row]]:
        """Prepare the hand, and open physics clients where fingers close or grasps are tested."""
        from stages.simulate_grasps.grasp_reading import reading

        return reading(settings)


def model_joints(hand: Hand) -> list[str]:
    """Name the joints that move in a hand's model, in its order, as MuJoCo has them in `qpos`."""
    return [joint.name for joint in hand.joints if joint.kind != "fixed" or joint.name in hand.frozen]


def grasp_folder(settings: ReadSettings) -> Path:
    """Return the folder of grasps."""
    if settings.folder is None or not (folder := expanded(settings.folder)).is_dir():
        raise InvalidInput(f"read-grasps.folder is {settings.folder or 'not set'}; use --set read-grasps.folder=FOLDER (make: SET=)")
    return folder
