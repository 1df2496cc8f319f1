"""Render scenes with Blender's Cycles: run by the Python of an environment that has `bpy`, and by nothing else.

    python blender_worker.py JOBS.json

JOBS.json lists jobs: a glTF file, the camera's pose and intrinsics as ours (it looks along -z, +y up; pixels), the nodes shown, the picture
to write, samples, and whether the picture is a mask (alpha, one ray through each pixel's centre). Seconds per job go into seconds.json.
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path

import bpy
from mathutils import Matrix

BOUNCES = 4


def render(job: dict) -> float:
    """Render one job; returns the seconds of rendering alone."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=job["scene"])
    scene = bpy.context.scene
    for node in bpy.data.objects:
        names = {node.name, *(parent.name for parent in parents(node))}
        node.hide_render = not any(name == shown or name.startswith(f"{shown}.") for name in names for shown in job["shown"])
    add_camera(scene, job["camera"])
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = job["samples"]
    scene.cycles.max_bounces = BOUNCES
    scene.cycles.seed = 0
    scene.render.resolution_x = scene.render.resolution_y = job["camera"]["resolution"]
    scene.render.film_transparent = job["mask"]
    scene.render.image_settings.color_mode = "RGBA" if job["mask"] else "RGB"
    scene.view_settings.view_transform = "Standard"
    if job["mask"]:
        scene.cycles.filter_width = 0.01  # the ray through the pixel's centre
        scene.cycles.use_denoising = False
    else:
        scene.cycles.use_denoising = True
        add_light(scene, job)
    scene.render.filepath = job["picture"]
    began = time.perf_counter()
    bpy.ops.render.render(write_still=True)
    return time.perf_counter() - began


def parents(node: bpy.types.Object) -> list:
    """List the ancestors of an object."""
    ancestors = []
    while node.parent:
        node = node.parent
        ancestors.append(node)
    return ancestors


def add_camera(scene: bpy.types.Scene, described: dict) -> None:
    """Set up the camera: the same pose and intrinsics give the same pixels."""
    camera = bpy.data.cameras.new("camera")
    side = described["resolution"]
    camera.sensor_fit, camera.sensor_width = "HORIZONTAL", 36.0
    camera.lens = described["focal"][0] * camera.sensor_width / side
    camera.shift_x = 0.5 - described["centre"][0] / side
    camera.shift_y = described["centre"][1] / side - 0.5
    camera.clip_start, camera.clip_end = 0.01, 100
    node = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(node)
    node.matrix_world = Matrix(described["pose"])
    scene.camera = node


def add_light(scene: bpy.types.Scene, job: dict) -> None:
    """Add a large lamp above, for soft shadows, a bright surrounding, and a floor below the scene."""
    lowest = min((node.matrix_world @ point.co).z for node in bpy.data.objects if visible_mesh(node) for point in node.data.vertices)
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs[0].default_value = (0.9, 0.93, 1.0, 1)
    world.node_tree.nodes["Background"].inputs[1].default_value = 0.55
    scene.world = world
    lamp = bpy.data.lights.new("lamp", "AREA")
    lamp.energy, lamp.size = 45, 1.2
    node = bpy.data.objects.new("lamp", lamp)
    scene.collection.objects.link(node)
    x, y, z = job["target"]
    node.location = (x + 0.5, y - 0.9, z + 1.3)
    node.rotation_euler = (math.atan2(math.hypot(0.5, 0.9), 1.3), 0, math.atan2(0.5, 0.9))
    bpy.ops.mesh.primitive_plane_add(size=30, location=(x, y, lowest - 0.001))
    floor = bpy.data.materials.new("floor")
    floor.diffuse_color = (0.8, 0.8, 0.8, 1)
    floor.use_nodes = True
    floor.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.62, 0.64, 0.68, 1)
    floor.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.9
    bpy.context.object.data.materials.append(floor)


def visible_mesh(node: bpy.types.Object) -> bool:
    return node.type == "MESH" and not node.hide_render


if __name__ == "__main__":
    listed = Path(sys.argv[1])
    seconds = {job["picture"]: render(job) for job in json.loads(listed.read_text())}
    listed.with_name("seconds.json").write_text(json.dumps(seconds, indent=1))
