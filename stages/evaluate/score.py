"""Reconstructions of another method, from files, measured as those of networks."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.config.settings import setting
from pipeline.console import pluralise
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import Cost, DatasetJob
from pipeline.errors import InvalidInput, StageError
from pipeline.models.reconstruction import Reconstruction
from pipeline.store.record import library_versions
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.evaluate.evaluation_files import METHOD_NAME
from stages.evaluate.grasp_protocol import GraspProtocol
from stages.evaluate.reconstructors import Case
from stages.evaluate.scored_files import ScoredFiles, find_faults, find_files, read_surface
from stages.evaluate.stage import Evaluate, GraspMeasuringSettings


class ScoreSettings(GraspMeasuringSettings):
    """Choose which files `vt-pipeline score` measures, and how; these settings are the command's."""

    method: str = setting(..., "name of the method, in tables", changes="definition", pattern=METHOD_NAME)
    files: str = setting(..., "SHA-256 of all files of the folder, with their names", changes="definition")
    given: int = setting(1, "grasps that the files in the folder itself were made from", ge=1, changes="definition")
    misplaced: bool = setting(False, "whether reconstructions that are far from their objects are measured too", changes="definition")


class Files:
    """The files of a method; call `find` first."""

    charts = has_charts = keeps_surfaces = False
    inputs: Mapping[str, Any] = {"image": None, "touch": True}  # nobody knows them; it is compared with the networks that touch

    def __init__(self, name: str, folder: Path, artifacts: Sequence[Artifact]) -> None:
        self.name, self.folder = name, folder
        self.image, self.touch = "unoccluded" if VISION in artifacts else None, TOUCH in artifacts
        self.files: ScoredFiles
        self.sparse: list[int] = []  # points of the clouds that have fewer than are measured

    def find(self, protocol: GraspProtocol, settings: ScoreSettings) -> None:
        """List the files of the test objects; an `InvalidInput` names all that are missing or cannot be scored."""
        rows, every = protocol.objects.rows, ObjectRows(protocol.job.data, ["points"], None)
        untested = [name for name in (*every.object_ids, *every.failed) if name not in rows.object_ids]
        self.files = find_files(self.folder, rows.object_ids, untested, settings.given, protocol.touched.shape[1])

        def truth(object_id: str) -> Any:
            return protocol.objects.points(rows.object_ids.index(object_id))

        if faults := list(find_faults(self.files, self.folder, truth, misplaced=settings.misplaced)):
            raise InvalidInput(f"{self.folder} cannot be scored:\n  " + "\n  ".join(faults))
        self.points = protocol.objects.count

    def cases(self, available: int, numbers: Sequence[int]) -> list[Case]:
        """List the numbers of grasps, and the first grasps, that have files."""
        return [
            Case(first, tuple((first + step) % available for step in range(count)), count, (first,))
            for count, first in sorted(self.files.paths)
        ]

    def reconstruct(self, objects: ObjectRows, work: Sequence[tuple[str, Case]]) -> list[Reconstruction]:
        """Read the files; raise a `StageError` if one has become unreadable since it was checked."""
        try:
            surfaces = [read_surface(self.files.paths[case.grasp_count, case.first][object_id]) for object_id, case in work]
        except InvalidInput as error:
            raise StageError(f"{self.folder} changed while it was measured: {error}; score it again") from error
        self.sparse += [len(item.vertices) for item in surfaces if not len(item.faces) and len(item.vertices) < self.points]
        return surfaces

    def remarks(self) -> Iterator[str]:
        """Report files that were not scored, and point clouds with fewer points than are measured."""
        if self.files.unused:
            yield f"{pluralise(len(self.files.unused), 'file')} of objects outside the test split: not scored"
        if self.sparse:
            yield (
                f"{pluralise(len(self.sparse), 'point cloud')} with fewer than {self.points} points, {min(self.sparse)} or more: all of "
                "them are measured, and distances are larger than a surface's"
            )


class Score(Evaluate):
    """Measure the files of one method with the draws of `evaluate`, so that a network's own meshes get its own figures."""

    name = "score"
    summary = "Another method's reconstructions on the test objects, from files: the tables of `evaluate`."
    settings_type = ScoreSettings

    def __init__(
        self,
        folder: Path,  # holds the files, as `find_files` takes them
        artifacts: Sequence[Artifact],  # existing ones beside `surfaces` and `grasps` that the baselines use
    ) -> None:
        self.folder, self.artifacts = folder, tuple(artifacts)

    def inputs(self, settings: Any) -> tuple[Artifact, ...]:
        """Name the artifacts of the objects, of the touch sites, and of the baselines."""
        return (SURFACES, GRASPS, *self.artifacts)

    def models(self, settings: Any) -> tuple[str, ...]:
        return ()

    def writes(self, settings: Any) -> str:
        return f"scores/{settings.method}"

    def cost(self, settings: Any, objects: int) -> Cost:
        """Estimate the reading and measuring of a fifth of the objects, and their baselines."""
        return Cost(seconds=objects, kilobytes=10 * objects)

    def reconstructors(self, job: DatasetJob) -> list[Files]:
        return [Files(job.settings.method, self.folder, self.artifacts)]

    def protocol(self, job: DatasetJob, reconstructors: Any) -> GraspProtocol:
        """Open the objects, and check all files before any is measured."""
        protocol = GraspProtocol(job, reconstructors)
        for files in reconstructors:
            files.find(protocol, job.settings)
        return protocol

    def attributes(self, job: DatasetJob, protocol: Any) -> dict[str, Any]:
        """Return the version, for those who cite the score."""
        return {"vt_pipeline": library_versions()["vt-pipeline"]}
