"""Commands run from the wheel in an empty folder, without the clone."""

import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from tests import wheel_commands

ROOT = Path(__file__).parents[1]
PACKAGES = ("vt_pipeline", "pipeline", "stages", "schemas", "data_manifests")

RUN = """
import sys
from pathlib import Path
from wheel_commands import COMMANDS, LATER, LIBRARY

import pipeline.__main__
assert Path(pipeline.__file__).is_relative_to(sys.argv[1]), pipeline.__file__
def run(commands):
    for words in commands:
        sys.argv[1:] = words
        try:
            pipeline.__main__.main()
        except SystemExit as end:
            assert not end.code, words


run(COMMANDS)
exec(LIBRARY)
run(LATER)
"""
"""One process for all commands: each would import and compile the same again."""


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """Build the wheel and unpack it."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder / "built"]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel_file,) = (folder / "built").glob("*.whl")
    with zipfile.ZipFile(wheel_file) as archive:
        archive.extractall(folder / "unpacked")
    return folder / "unpacked"


def files_below(folder: Path) -> set[str]:
    files = {path.relative_to(folder) for name in PACKAGES for path in (folder / name).rglob("*") if path.is_file()}
    return {path.as_posix() for path in files if "__pycache__" not in path.parts}


def test_wheel_holds_every_file_of_the_packages(unpacked):
    assert files_below(unpacked) == files_below(ROOT)
    assert (unpacked / "vt_pipeline" / "py.typed").exists()
    (metadata,) = unpacked.glob("*.dist-info")
    assert {path.name for path in unpacked.iterdir()} == {*PACKAGES, metadata.name}
    assert "vt-pipeline = pipeline.__main__:main" in (metadata / "entry_points.txt").read_text()


@pytest.mark.slow
def test_commands_and_library_run_from_the_wheel_without_the_clone(unpacked, tmp_path):
    (tmp_path / "two-meshes.yaml").write_text(wheel_commands.MANIFEST)
    (tmp_path / "wheel_commands.py").write_text(Path(wheel_commands.__file__).read_text())
    paths = [unpacked, sysconfig.get_path("purelib"), sysconfig.get_path("platlib")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths)), "OMP_NUM_THREADS": "1"}
    run = [sys.executable, "-S", "-c", RUN, unpacked]  # -S: no .pth file adds the clone
    completed = subprocess.run(run, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stdout + completed.stderr
    assert str(unpacked / "vt_pipeline") in completed.stdout
    assert "read by the pretrained network for gelsight_mini" in completed.stdout
    for name in wheel_commands.WRITTEN:
        assert (tmp_path / name).stat().st_size > 0
