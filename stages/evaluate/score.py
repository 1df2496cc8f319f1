"""Reconstructions of another method, from files, measured as those of networks."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from rich.markup import escape

from pipeline.config.manifest import SPLITS
from pipeline.console import pluralise
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import Cost, DatasetJob, DatasetStage
from pipeline.engine.versions import library_versions
from pipeline.errors import InvalidInput, StageError
from pipeline.models.reconstruction import Reconstruction
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.evaluate.evaluation_files import Figures
from stages.evaluate.grasp_protocol import GraspProtocol
from stages.evaluate.measure import Case, measure
from stages.evaluate.scored_files import ScoredFiles, find_faults, find_files, read_surface
from stages.evaluate.settings import ScoreSettings
from stages.evaluate.stage import write_measured


@dataclass(frozen=True)
class Method:
    """A method of which only files are known, in place of a network."""

    image: str | None  # baselines that use images are measured beside it
    touch: bool  # baselines that use touches are measured beside it
    has_charts: bool = False  # its surfaces are meshes or point clouds


class ScoreProtocol(GraspProtocol):
    """Measure files as `evaluate` measures networks: with its draws, so that a network's own meshes get its own figures."""

    keeps_surfaces = False
    reads_charts: ClassVar[bool] = False

    def __init__(self, job: DatasetJob, method: Method, folder: Path) -> None:
        super().__init__(job, [method])
        rows, settings = self.objects.rows, job.settings
        every = ObjectRows(job.data, ["points"], None)
        untested = [name for name in (*every.object_ids, *every.left_out) if name not in rows.object_ids]
        self.folder, self.files = folder, find_files(folder, rows.object_ids, untested, settings.given, self.touched.shape[1])
        self.sparse: list[int] = []

    def cases(self, model: Any) -> list[Case]:
        """List the numbers of grasps, and the first grasps, that have files."""
        available = self.touched.shape[1]
        return [
            Case(first, tuple((first + step) % available for step in range(count)), count, (first,))
            for count, first in sorted(self.files.paths)
        ]

    def reconstruct(self, model: Any, work: Sequence[tuple[int, Case]]) -> list[Reconstruction]:
        """Read the files; raise a `StageError` if one has become unreadable since it was checked."""
        try:
            surfaces = [
                read_surface(self.files.paths[case.grasp_count, case.first][self.objects.rows.object_ids[row]]) for row, case in work
            ]
            self.sparse += [
                count for surface in surfaces if not len(surface.faces) and (count := len(surface.vertices)) < self.objects.count
            ]
            return surfaces
        except InvalidInput as error:
            raise StageError(f"{self.folder} changed while it was measured: {error}; score it again") from error

    def refuse_faults(self) -> ScoredFiles:
        """Return the files if each can be scored; otherwise raise an `InvalidInput` that names all that cannot."""

        def truth(object_id: str) -> Any:
            return self.objects.points(self.objects.rows.object_ids.index(object_id))

        faults = list(find_faults(self.files, self.folder, truth, misplaced=self.job.settings.misplaced))
        if faults:
            raise InvalidInput(f"{self.folder} cannot be scored:\n  " + "\n  ".join(faults))
        return self.files


class Score(DatasetStage):
    """Measure the files of one method on the test objects."""

    name = "score"
    summary = "Another method's reconstructions on the test objects, from files: the tables of `evaluate`."
    settings_type = ScoreSettings

    def __init__(
        self,
        folder: Path,  # holds the files, as `find_files` takes them
        reads: Sequence[Artifact],  # existing artifacts beside `surfaces` and `grasps` that the baselines use
    ) -> None:
        self.folder, self.artifacts = folder, tuple(reads)

    def inputs(self, settings: ScoreSettings) -> tuple[Artifact, ...]:
        """Name the artifacts of the objects, of the touch sites, and of the baselines."""
        return (SURFACES, GRASPS, *self.artifacts)

    def splits(self, settings: ScoreSettings) -> tuple[str, ...]:
        """Name all: test objects are measured, training objects retrieved, and Table 1 counts all."""
        return SPLITS

    def writes(self, settings: ScoreSettings) -> str:
        """Name the folder of the method's score."""
        return f"scores/{settings.method}"

    def cost(self, settings: ScoreSettings, objects: int) -> Cost:
        """Estimate the reading and measuring of a fifth of the objects, and their baselines."""
        return Cost(seconds=objects, kilobytes=10 * objects)

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Check all files, measure them and the baselines, and write the tables."""
        settings: ScoreSettings = job.settings
        method = Method("unoccluded" if VISION in self.artifacts else None, TOUCH in self.artifacts)
        protocol = ScoreProtocol(job, method, self.folder)
        files = protocol.refuse_faults()
        if files.unused:
            job.console.print(escape(f"{pluralise(len(files.unused), 'file')} of objects outside the test split: not scored"))
        rows, _ = measure(settings.method, method, protocol, job)
        if protocol.sparse:
            job.console.print(
                f"{pluralise(len(protocol.sparse), 'point cloud')} with fewer than {protocol.objects.count} points, {min(protocol.sparse)} "
                "or more: all of them are taken, and distances are larger than a surface's"
            )
        figures = {settings.method: Figures(protocol.objects.rows.object_ids, rows)}
        groups = {"objects": protocol.objects.table(), **protocol.extra()}
        inputs, version = {settings.method: {"image": None, "touch": True}}, {"vt_pipeline": library_versions()["vt-pipeline"]}
        write_measured(job, protocol, figures, groups, inputs, version)
        grasps = sorted({number for number, _ in files.paths})
        return {"objects": len(protocol.objects), "files": sum(map(len, files.paths.values())), "grasps": grasps}
