"""Commands for the wheel outside any clone, as a user without anything else installed types them."""

from stages.registry import DATASET

MANIFEST = """\
name: two-meshes
description: Two meshes of the pybullet wheel.
seed: 0
splits: {train: 0.5, valid: 0.5, test: 0}
sources:
  - kind: pybullet
    licence: zlib (bullet3)
    up: z
    files: {duck: {file: duck.obj, up: y}, teddy: {file: teddy2_VHACD_CHs.obj}}
"""

MADE = ["--manifest", "two-meshes.yaml", "--data", "data", "--executor", "serial"]
COMMANDS = (
    *(["run", stage, *MADE, "--set", "simulate-grasps.grasps=1", "--set", "simulate-grasps.attempts=5"] for stage in DATASET),
    ["summary", "data"],
    ["run", "train-gcn", *MADE, "--set", "train-gcn.configuration=none", "--set", "train-gcn.epochs=1"],
    ["report", "data"],
    ["predict", "--data", "data", "--configuration", "none", "--object", "duck", "duck.obj"],
)
"""Arguments of vt-pipeline, in a folder that holds `MANIFEST` as two-meshes.yaml."""

WRITTEN = ("data/contact-sheet.png", "data/report/index.html", "duck.obj")

LIBRARY = """
import numpy, PIL.Image, vt_pipeline
touch = vt_pipeline.touch(vt_pipeline.load_object("duck.obj"), vt_pipeline.load_sensor("gelsight_mini"), numpy.eye(4))
print(vt_pipeline.__file__, touch)
x, y = numpy.meshgrid(numpy.linspace(-0.01, 0.01, 320), numpy.linspace(-0.0075, 0.0075, 240))
ball = vt_pipeline.press(-(x**2 + y**2) / 0.008, touch.sensor, depth=5e-4)
PIL.Image.fromarray(ball.image).save("ball.png")
PIL.Image.fromarray(vt_pipeline.untouched_image(touch.sensor)).save("untouched.png")
"""
LATER = (["read-touch", "ball.png", "--untouched", "untouched.png", "--sensor", "gelsight_mini"],)
"""Arguments of vt-pipeline for what `LIBRARY` writes."""
