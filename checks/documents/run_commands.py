"""Run the commands of the documents, page after page, as `make test-docs` does; the file's name keeps it from `make test`.

They run as they are printed, in a copy of the repository whose manifests have four objects and whose preset `draft` learns in
seconds; where they do not say which networks to train, two. `NOT_RUN` names those that cannot run here, and why.
"""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import trimesh
import yaml

ROOT = Path(__file__).parents[2]
GUIDES = (
    "learning",
    "own-photographs",
    "other-programs",
    "recipes",
    "hand-sensor-camera",
    "speed-and-accuracy",
    "installing",
    "objects",
    "own-grasps",
    "library",
    "slides",
    "reading",
)
STAGES = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs" / "how-it-works").glob("*.md"))
PAGES = ("README.md", "docs/index.md", *(f"docs/guide/{name}.md" for name in GUIDES), "docs/how-it-works.md", *STAGES, "CONTRIBUTING.md")
"""In this order: later pages use what the commands of earlier ones make."""

OTHER_TARGET = "is a test or a measurement of its own"
NOT_RUN = {
    r"^make (test|lint|faults|bench-before)\b": OTHER_TARGET,
    r"^make reproduce": "dozens of trainings; tests/test_makefile.py holds its commands",
    r"^make train PRESET=paper": "the supplement's networks, days on a CPU",
    r"OBJECTS=~/r2n2": "the cited renderings, which are not to be had here",
    r"/DexGraspBench/": "its files are not to be had here; tests/examples runs the script on some",
    r"pip (install|wheel)|^PIP_|^uv/": "would change the environment that runs this",
    r"vt-pipeline advise .*--(within|error)": "needs minutes of tradeoff under the same code; tests/tradeoff runs both",
    r"jupyter lab|^tensorboard": "a server; make test-docs runs the notebook",
    r"devices=4$": "four processes; tests/training/test_processes.py runs two",
    r"calibrate-sensor": "takes photographs; tests/contrib/calibration/test_calibrate_sensor.py makes some",
    r"vt-pipeline read-touch": "takes photographs; tests/real_touch/test_read_touch.py makes some",
    r"--to (parquet|lerobot)": "needs pyarrow; make test-exports runs them",
    r"s3://|AWS_": "needs a server; make test-storage runs every stage on two",
    r"^dask |--scheduler tcp": "needs machines; tests/engine/test_executors.py runs a scheduler with workers",
    r"^vt-pipeline submit": "needs Slurm; make test-slurm runs every stage on one",
}
"""Commands that match are not run, for this reason."""

NOT_RUN_PAGES = {
    "docs/scale.md": "says below each block whether it was run: most need a cluster",
    "docs/leaderboard.md": "makes 240 objects; tests/examples/test_examples.py scores the example",
}

SOURCES = {
    "toy": [
        {"kind": "procedural", "licence": "MIT", "seed": 0, "count": {"bottle": 1, "knife": 1}},
        {"kind": "pybullet", "licence": "zlib", "up": "z", "files": {"duck": {"file": "duck.obj", "up": "y"}}, "random_urdfs": 1},
    ],
    "procedural": [{"kind": "procedural", "licence": "MIT", "seed": 1, "count": {"bottle": 2, "knife": 2}}],
    "four-classes": [{"kind": "procedural", "licence": "MIT", "seed": 1, "count": {"bottle": 2, "knife": 2}}],
}
SHOWN = {"docs/pictures bottle-0001": "docs/pictures random-000", "pictures bottle-0008": "pictures knife-0000"}
"""In place of objects that the pages picture: some of the small manifests' test splits."""

CONFIGURATIONS = "touch occluded-touch"
GRAPH = {"epochs": 1, "gcn_layers": 3, "gcn_features": 12, "encoder_width": 0.1, "loss_points": 300}
DRAFT = {
    "sample-surfaces": {"points": 3000},
    "simulate-grasps": {"attempts": 6, "ik_samples": 512},
    "simulate-presses": {"presses": 5, "pixels": 40},
    "simulate-slides": {"slides": 2, "steps": 16, "rate": 8, "pixels": 40},
    "sample-distances": {"queries": 1024},
    "train-unet": {"width": 4, "epochs": 1},
    "train-touch": {"width": 4, "epochs": 1},
    "fit-charts": {"max_iterations": 60},
    "train-gcn": {**GRAPH, "encoder_layers": 12},
    "train-implicit": {"epochs": 1, "features": 8, "encoder_width": 0.1, "spacing": 0.02},
    "train-single-image": {**GRAPH, "encoder_linear": 12},
    "evaluate": {"points": 1000},
    "evaluate-single-image": {"points": 1000, "views": 1},
}


def commands(page: str) -> list[str]:
    """List the commands of a page's shell blocks, without comments."""
    text = re.sub(r"\s*\\\n\s*", " ", (ROOT / page).read_text())
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return [line for block in blocks for line in (re.sub(r"(^|\s+)#.*", "", line) for line in block.splitlines()) if line]


def reasons(command: str) -> list[str]:
    """List the patterns of `NOT_RUN` that match a command."""
    return [pattern for pattern in NOT_RUN if re.search(pattern, command)]


@pytest.fixture(scope="module")
def repository(tmp_path_factory) -> Path:
    """Copy the repository with small manifests, a small preset, and the user's files that the documents name."""
    copy = tmp_path_factory.mktemp("documents") / "repository"
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".*", "data", "site", "__pycache__"))
    (copy / ".venv").symlink_to(ROOT / ".venv")
    for name in ("pyproject.toml", "constraints.txt"):
        os.utime(copy / name, (0, 0))  # older than what says when was installed: else make installs the copy there
    manifests = copy / "data_manifests"
    renderings = yaml.safe_load((manifests / "single-image.yaml").read_text())
    for name, sources in (*SOURCES.items(), ("single-image", renderings["sources"])):
        splits = {"train": 0.5, "valid": 0.25, "test": 0.25}
        said = {"name": name, "description": "small", "seed": 0, "splits": splits, "sources": sources}
        (manifests / f"{name}.yaml").write_text(yaml.safe_dump(said))
    presets = copy / "pipeline" / "assets" / "presets.yaml"
    presets.write_text(yaml.safe_dump(yaml.safe_load(presets.read_text()) | {"draft": DRAFT}))
    (copy / "home" / "meshes" / "boxes").mkdir(parents=True)
    for number in range(4):
        trimesh.creation.box((0.1 + 0.02 * number, 0.2, 0.3)).export(copy / "home" / "meshes" / "boxes" / f"box-{number}.stl")
    for kind, shipped, own in (
        ("sensors", "gel_16mm", "my_gel"),
        ("scenes", "supplement", "my_scene"),
        ("hands", "allegro_right", "my_hand"),
    ):
        folder = copy / "pipeline" / "assets" / kind
        (copy / f"{own}.yaml").write_text((folder / f"{shipped}.yaml").read_text().replace("model: ", f"model: {folder}/"))
    return copy


def run(command: str, repository: Path) -> None:
    """Run a command as a reader would; where it fails, the test fails with what it printed."""
    path = f"{ROOT / '.venv' / 'bin'}{os.pathsep}{os.environ['PATH']}"
    own = {"PATH": path, "HOME": str(repository / "home"), "PYTHONPATH": str(repository), "CONFIGURATIONS": CONFIGURATIONS}
    environment = {**os.environ, **own}
    done = subprocess.run(
        ["bash", "-c", command], cwd=repository, env=environment, capture_output=True, text=True, check=False, timeout=1800
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"


DONE: set[str] = set()


@pytest.mark.parametrize("page", PAGES)
def test_commands_of_a_page_run(page, repository):
    for command in commands(page):
        asked = re.sub(r"\bDATA\b(?!=)", "data/cluster", command)
        asked = re.sub("|".join(SHOWN), lambda found: SHOWN[found[0]], asked)
        if reasons(command) or asked in DONE:
            continue
        if "data/cluster" in asked and not (repository / "data" / "cluster").exists():
            for stage in ("sample-surfaces", "simulate-grasps"):
                run(f"vt-pipeline run {stage} --data data/cluster --shards 8", repository)
        run(asked, repository)
        DONE.add(asked)
