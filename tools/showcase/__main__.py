"""Render a showcase of a dataset with Blender: grasps, a turntable, touch to reconstruction; and compare its masks with ours.

    python -m tools.showcase DATA OUT --blender .venv-showcase/bin/python

Blender (`bpy`) needs an older numpy, so it is another environment's Python that renders; it is given glTF scenes and our cameras.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.vision.camera import Camera, camera_pose, look_at
from pipeline.kernels.vision.labels import Label
from pipeline.reports.contact_sheet import BandMaker
from pipeline.reports.contact_sheet_page import spread_evenly
from pipeline.reports.grasp_scene import GraspScenes
from pipeline.reports.report_source import SCENE, ReportSource, dataset_scene
from pipeline.reports.second_view import grasp_cameras
from pipeline.store.storage import place
from stages.render_vision.renderer import Renderer

GRASPS, PIXELS, SAMPLES = 10, 1024, 32
FRAMES, FRAME_PIXELS, FRAME_SAMPLES = 24, 360, 12
MASK_PIXELS, MASKS = 512, 3
FOCAL, ROOM = 1.6, 4.2
"""The camera's focal length in picture sides, and its distance from the object's centre in radii of the object."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data")
    parser.add_argument("out", type=Path)
    parser.add_argument("--blender", type=Path, required=True, help="the Python that has bpy")
    parser.add_argument("--grasps", type=int, default=GRASPS)
    parser.add_argument("--pixels", type=int, default=PIXELS)
    arguments = parser.parse_args()
    source, out = ReportSource(place(arguments.data)), arguments.out.resolve()
    (out / "scenes").mkdir(parents=True, exist_ok=True)
    object_ids = spread_evenly(source.object_ids, arguments.grasps)
    jobs, ours = _grasps(source, object_ids, out, arguments.pixels)
    jobs += _turntable(jobs[0], out)
    jobs += _strip(source, out, arguments.pixels // 2)
    jobs_file = out / "jobs.json"
    jobs_file.write_text(json.dumps(jobs, indent=1))
    worker = Path(__file__).with_name("blender_worker.py")
    subprocess.run([arguments.blender, worker, jobs_file], check=True, stdout=subprocess.DEVNULL)
    seconds = json.loads((out / "seconds.json").read_text())
    _save_turntable(out)
    _save_strip(source, out, arguments.pixels // 2)
    for name, (mask, ours_seconds) in ours.items():
        theirs = np.asarray(Image.open(out / f"{name}-mask.png"))[..., 3] > 127
        iou = (mask & theirs).sum() / (mask | theirs).sum()
        blender_seconds = seconds[str(out / f"{name}.png")]
        print(f"{name}: masks agree to {iou:.5f} (intersection over union); ours {ours_seconds:.2f} s, Blender {blender_seconds:.1f} s")
    print(f"{out}: {len(object_ids)} grasps, turntable.gif" + (", touch-to-shape.png" if source.evaluation else ""))


def _grasps(source: ReportSource, object_ids: Iterable[str], out: Path, pixels: int) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Write the scene of each object's best grasp; returns what Blender renders, and our masks with their seconds."""
    scenes = GraspScenes(source.hand(), source.sensors(), small=False)
    scene = dataset_scene(source.directory)
    jobs, masks = [], []
    ours: dict[str, Any] = {}
    for object_id in object_ids:
        rows = source.rows(object_id)
        path = out / "scenes" / f"{object_id}.glb"
        path.write_bytes(scenes.glb(scenes.scene(rows, [0])))
        with Renderer(scene, pixels) as renderer:
            maker = BandMaker(renderer, scene=scene, hand=source.hand(), sensors=source.sensors())
            with maker.grasp_view(rows, 0) as view:
                near, _ = grasp_cameras(renderer, scene, 96, view)
                camera, target = _beside(near, read_mesh(rows["surfaces"]).vertices, pixels)
                began = time.perf_counter()
                posed_meshes = [(view.object_mesh[0], np.eye(4)), *((handle, pose) for handle, _, pose in view.hand)]
                image = renderer.render(posed_meshes, camera).rgb
                seconds = time.perf_counter() - began
                mask = renderer.render(posed_meshes[:1], camera.with_resolution(MASK_PIXELS)).segmentation == Label.OBJECT
        Image.fromarray(image).save(out / f"{object_id}-ours.png")
        job = {"scene": str(path), "camera": _described_camera(camera), "target": target.tolist(), "samples": SAMPLES, "mask": False}
        jobs.append(job | {"shown": ["object", "grasp-0-hand"], "picture": str(out / f"{object_id}.png")})
        if len(ours) < MASKS:
            small = _described_camera(camera.with_resolution(MASK_PIXELS))
            masks.append(
                job | {"camera": small, "samples": 1, "mask": True, "shown": ["object"], "picture": str(out / f"{object_id}-mask.png")}
            )
            ours[object_id] = (mask, seconds)
    return jobs + masks, ours


def _beside(near: Camera, vertices: NDArray[np.float64], pixels: int) -> tuple[Camera, NDArray[np.float64]]:
    """Place a camera in the direction of `near`, a little above, that sees the object and the hand; returns what it looks at, too."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    target, radius = (low + high) / 2, np.linalg.norm(high - low) / 2
    direction = camera_pose(near)[:3, 2]
    direction[2] = max(direction[2], 0.25)
    position = target + ROOM * radius * direction / np.linalg.norm(direction)
    focal, middle = FOCAL * pixels, pixels / 2
    lens = near.model_copy(update={"focal": (focal, focal), "centre": (middle, middle), "resolution": pixels})
    return look_at(lens, tuple(position.tolist()), tuple(target.tolist())), target


def _described_camera(camera: Camera) -> dict[str, Any]:
    pose = camera_pose(camera).tolist()
    return {"pose": pose, "focal": camera.focal, "centre": camera.centre, "resolution": camera.resolution}


def _turntable(job: dict[str, Any], out: Path) -> list[dict[str, Any]]:
    """Turn the first picture's camera around the object."""
    target, frames = np.array(job["target"]), []
    for number in range(FRAMES):
        angle = 2 * np.pi * number / FRAMES
        rotation = np.eye(4)
        rotation[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        rotation[:3, 3] = target - rotation[:3, :3] @ target
        scale = FRAME_PIXELS / job["camera"]["resolution"]
        camera: dict[str, Any] = {name: [scale * value for value in job["camera"][name]] for name in ("focal", "centre")}
        camera |= {"pose": (rotation @ np.array(job["camera"]["pose"])).tolist(), "resolution": FRAME_PIXELS}
        frames.append(job | {"camera": camera, "samples": FRAME_SAMPLES, "picture": str(out / f"turn-{number:02d}.png")})
    return frames


def _save_turntable(out: Path) -> None:
    frames = [Image.open(out / f"turn-{number:02d}.png").convert("P", palette=Image.Palette.ADAPTIVE) for number in range(FRAMES)]
    frames[0].save(out / "turntable.gif", save_all=True, append_images=frames[1:], duration=100, loop=0)
    for number in range(FRAMES):
        (out / f"turn-{number:02d}.png").unlink()


def _shown_case(source: ReportSource) -> tuple[str, str] | None:
    """Find the evaluated object and the prediction that the strip shows: the last configuration that feels, with the most grasps."""
    if source.evaluation is None or "charts" not in source.collections:
        return None
    object_id = source.evaluation.object_ids[0]
    felt = [name for name in source.evaluation.surfaces(object_id) if "touch" in name]
    return (object_id, felt[-1]) if felt else None


def _strip(source: ReportSource, out: Path, pixels: int) -> list[dict[str, Any]]:
    """Write the scenes of the strip: touch charts alone, and a prediction with them."""
    if (case := _shown_case(source)) is None:
        return []
    object_id, name = case
    rows = source.rows(object_id)
    scenes = GraspScenes(source.hand(), source.sensors(), small=False)
    scene = scenes.scene(rows)
    for geometry, mesh in scenes.predictions({name: source.evaluation.surfaces(object_id)[name]}).geometry.items():  # type: ignore[union-attr]
        scenes.add(scene, geometry, mesh, "prediction")
    path = out / "scenes" / "strip.glb"
    path.write_bytes(scenes.glb(scene))
    vertices = read_mesh(rows["surfaces"]).vertices
    camera, target = _beside(load_scene(SCENE).camera, vertices, pixels)
    charts = [f"grasp-{number}-charts" for number in range(len(rows["grasps"]["hand_pose"]))]
    common = {"scene": str(path), "camera": _described_camera(camera), "target": target.tolist(), "samples": SAMPLES, "mask": False}
    pictures = {"strip-object": ["object"], "strip-charts": charts, "strip-shape": ["prediction", *charts]}
    return [common | {"shown": parts, "picture": str(out / f"{name}.png")} for name, parts in pictures.items()]


def _save_strip(source: ReportSource, out: Path, pixels: int) -> None:
    if (case := _shown_case(source)) is None:
        return
    rows = source.rows(case[0])
    area = rows["grasps"]["contact_area"]
    tactile_image = rows["touch"]["tactile_image"][np.unravel_index(np.argmax(area), area.shape)]  # of the touch that shows most
    touch = Image.fromarray(tactile_image).resize((pixels, pixels), Image.Resampling.LANCZOS)
    parts = [Image.open(out / "strip-object.png"), touch, *(Image.open(out / f"strip-{name}.png") for name in ("charts", "shape"))]
    strip = Image.new("RGB", (len(parts) * (pixels + 8) - 8, pixels), "white")
    for number, part in enumerate(parts):
        strip.paste(part, (number * (pixels + 8), 0))
    strip.save(out / "touch-to-shape.png", optimize=True)


if __name__ == "__main__":
    main()
