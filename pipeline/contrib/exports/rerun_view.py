"""Grasps in Rerun, a viewer for robots and sensors: object, hand, sensors, images, local points, charts and predictions."""

import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Meter, abbreviate, errors, pluralise
from pipeline.contrib.report.report_source import ReportSource
from pipeline.dataset.touch_charts import is_surface
from pipeline.drawing.contact_sheet_page import finger_colors
from pipeline.drawing.grasp_scene import GraspScenes, Rows
from pipeline.drawing.mesh_colors import TOUCH_COLOR, VISION_COLORS, Y_UP
from pipeline.errors import InvalidInput
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.touch.contact import local_points
from pipeline.store.atomic import name_in_errors
from pipeline.store.storage import Place, temporary

POINT = 2e-4
"""m: radius of a local point."""


def view_grasps(
    data: Place,
    object_id: str,
    grasp: int | None,  # from 0; None for all
    save: Path | None,  # a file, .rrd, in place of a window
) -> list[int]:  # the grasps shown
    """Show grasps of an object in Rerun's viewer, or save them: timeline `grasp`, an entity per part of the scene."""
    rerun = _rerun()
    if save is None and sys.platform == "linux" and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))):
        raise InvalidInput("the viewer needs a screen; write a file with --save FILE.rrd instead")  # it would never come up
    source = ReportSource(data)
    if object_id not in source.object_ids:
        failed = f", where it failed: {source.failures[object_id][1]}" if object_id in source.failures else ""
        raise InvalidInput(f"{object_id} is not a usable object of {data}{failed}; it has {abbreviate(source.object_ids)}")
    rows = source.rows(object_id)
    grasps = len(rows["grasps"]["hand_pose"])
    if grasp is not None and grasp >= grasps:
        raise InvalidInput(f"--grasp {grasp}: {object_id} has {pluralise(grasps, 'grasp')}, 0 to {grasps - 1}")
    selected = list(range(grasps)) if grasp is None else [grasp]
    recording = rerun.RecordingStream("vt-pipeline", recording_id=f"{data}/{object_id}")
    recorder = _Recorder(rerun, recording, source)
    if save is None:
        recording.spawn()
        recorder.record(object_id, rows, selected)
        return selected
    save.parent.mkdir(parents=True, exist_ok=True)
    with name_in_errors(save), temporary(save) as beside:
        recording.save(beside)
        recorder.record(object_id, rows, selected)
        beside.replace(save)
    return selected


def _rerun() -> Any:
    try:
        import rerun
    except ModuleNotFoundError as error:
        raise InvalidInput("the viewer is not installed; `pip install -c constraints.txt -e '.[view]'` installs it (130 MB)") from error
    return rerun


class _Recorder:
    """Logs an object and its grasps; lengths are m, frames the world's, z up."""

    def __init__(self, rerun: ModuleType, recording: Any, source: ReportSource) -> None:
        self.rr, self.recording, self.source = rerun, recording, source
        self.hand, self.sensors = source.hand(), source.sensors()
        self.names = [mount.name for mount in self.hand.sensors]

    def record(self, object_id: str, rows: Rows, grasps: list[int]) -> None:
        rr, log = self.rr, self.recording.log
        log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        scenes = GraspScenes(self.hand, self.sensors, small=False)
        log("world/object", rr.Transform3D(mat3x3=np.linalg.inv(Y_UP)[:3, :3]), static=True)
        log("world/object", rr.Asset3D(contents=scenes.glb(scenes.scene(rows, [])), media_type="model/gltf-binary"), static=True)
        for number, (link, mesh) in enumerate(self.hand.visual_meshes):
            color = mesh.look.base_color[mesh.look.face_material[0]]
            self._mesh(f"world/hand/{self.hand.links[link].name}/shape_{number}", mesh.vertices, mesh.faces, color, static=True)
        for name, (vertices, faces) in (self.source.evaluation.surfaces(object_id) if self.source.evaluation else {}).items():
            self._mesh(f"world/predictions/{name}", vertices, faces, VISION_COLORS[0], static=True)
        if "vision" in rows:
            log("camera/alone", rr.Image(rows["vision"]["unoccluded"][0]), static=True)
        with Meter(errors, "view", len(grasps), "grasps", after=1.0) as meter:
            for grasp in grasps:
                self.recording.set_time("grasp", sequence=grasp)
                self._grasp(rows, grasp)
                meter.advance()
        self.recording.flush()
        self.recording.disconnect()

    def _grasp(self, rows: Rows, grasp: int) -> None:
        rr, log, row = self.rr, self.recording.log, rows["grasps"]
        for link, frame in zip(
            self.hand.links, forward_kinematics(self.hand, row["hand_pose"][grasp], row["joint_angles"][grasp]), strict=True
        ):
            log(f"world/hand/{link.name}", _transform(rr, frame))
        log("joint_angles", rr.BarChart(row["joint_angles"][grasp]))
        if "vision" in rows and "occluded" in list(rows["vision"]):
            log("camera/in_grasp", rr.Image(rows["vision"]["occluded"][grasp, 0]))
            log("camera/segmentation", rr.SegmentationImage(rows["vision"]["segmentation"][1 + grasp, 0]))
        fingers = zip(self.names, self.sensors, finger_colors(len(self.names)), strict=True)
        for number, (name, sensor, color) in enumerate(fingers):
            half_size = [sensor.width / 2, sensor.height / 2, sensor.w / 2]
            pose, depth = row["sensor_pose"][grasp, number], rows["touch"]["depth"][grasp, number]
            log(f"world/sensors/{name}", _transform(rr, pose))
            log(f"world/sensors/{name}/gel", rr.Boxes3D(centers=[[0, 0, half_size[2]]], half_sizes=[half_size], colors=[color]))
            log(f"touch/{name}/tactile_image", rr.Image(rows["touch"]["tactile_image"][grasp, number]))
            log(f"touch/{name}/depth", rr.DepthImage(np.where(np.isfinite(depth), depth, 0), meter=1.0))
            points, count = local_points(depth, pose, sensor)
            log(f"world/local_points/{name}", rr.Points3D(points[:count], colors=[color], radii=POINT))
            if "charts" in rows:
                charts, path = rows["charts"], f"world/charts/{name}"
                if is_surface(charts["stop_rule"][grasp, number]):
                    self._mesh(path, charts["vertices"][grasp, number], charts["chart_faces"], TOUCH_COLOR)
                else:
                    log(path, rr.Clear(recursive=False))

    def _mesh(self, path: str, vertices: NDArray[Any], faces: NDArray[Any], color: Any, *, static: bool = False) -> None:
        mesh = self.rr.Mesh3D(vertex_positions=vertices, triangle_indices=faces, albedo_factor=list(map(int, color)))
        self.recording.log(path, mesh, static=static)


def _transform(rr: ModuleType, pose: NDArray[np.float64]) -> Any:
    return rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3])
