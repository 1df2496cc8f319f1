"""`tools/install.sh` installs what is missing, once, and says what it cannot install."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PYTHON = """
echo "$0 $*" >>log
if [ "$2" = venv ]; then mkdir -p "$3/bin"; cp "$0" "$3/bin/python"; touch "$3/pyvenv.cfg"; fi
case $2 in *print*) mkdir -p "$(dirname "$0")/../packages"; echo "$(dirname "$0")/../packages" ;; esac
"""
LIBRARIES = "libegl1 libgl1 libxrender1 libgl1-mesa-dri"
PIP = "-m pip install --quiet --disable-pip-version-check"


class Machine:
    """A repository, and a system whose programs write down what they are called with."""

    def __init__(self, root: Path) -> None:
        self.root = root
        for name in ("sh", "sed", "grep", "touch", "mkdir", "cp", "dirname", "rm"):
            (root / "programs").mkdir(exist_ok=True)
            (root / "programs" / name).symlink_to(str(shutil.which(name)))
        self.program("python3.11", PYTHON)
        for name in ("pyproject.toml", "constraints.txt"):
            self.write(name, age=100)

    def program(self, name: str, script: str) -> None:
        (self.root / "programs" / name).write_text(f"#!{shutil.which('sh')}\n{script}\n")
        (self.root / "programs" / name).chmod(0o755)

    def debian(self, *there: str, user: int) -> None:
        self.program("dpkg-query", "\n".join(f'echo "install ok installed {name}"' for name in there) + "\nexit 1")
        self.program("id", f"echo {user}")
        self.program("apt-get", 'echo "apt-get $*" >>log')

    def write(self, name: str, age: int = 0) -> None:
        (self.root / name).touch()
        now = (self.root / "programs").stat().st_mtime
        os.utime(self.root / name, (now - age, now - age))

    def install(self, what: str, venv: str = ".venv", python: str = "python3.11") -> subprocess.CompletedProcess[str]:
        command = ["sh", ROOT / "tools" / "install.sh", venv, python, what]
        environment = {"PATH": str(self.root / "programs")}
        return subprocess.run(command, cwd=self.root, env=environment, capture_output=True, text=True, check=False)

    def calls(self) -> list[str]:
        log = self.root / "log"
        found = log.read_text().replace(f"{self.root}/programs/", "").splitlines() if log.exists() else []
        log.unlink(missing_ok=True)
        return found


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path)


def test_packages_are_installed_once_and_again_when_the_pinned_ones_change(machine):
    assert machine.install("project").returncode == 0
    made = [f".venv/bin/python {PIP} -c constraints.txt -e ."]
    assert machine.calls() == ["python3.11 -c import ensurepip", "python3.11 -m venv .venv", *made]
    assert machine.install("dev").returncode == 0
    developed = [f".venv/bin/python {PIP} -c constraints.txt -e .[dev]"]
    assert machine.calls() == developed
    for what in ("project", "dev"):
        machine.install(what)
        assert machine.calls() == []
    for name in ("constraints.txt", ".venv/installed", ".venv/installed-dev"):
        machine.write(name, age={"constraints.txt": 10}.get(name, 50))
    machine.install("project")
    assert machine.calls() == made
    machine.install("dev")
    assert machine.calls() == developed


def test_an_installation_that_fails_is_tried_again(machine):
    machine.program("python3.11", PYTHON + 'if [ "$2" = pip ]; then exit 1; fi')
    for _ in range(2):
        assert machine.install("project").returncode != 0
        assert f".venv/bin/python {PIP} -c constraints.txt -e ." in machine.calls()


@pytest.mark.parametrize("user", [0, 1000])
def test_system_packages_that_are_missing_are_installed_by_root_and_named_to_others(user, machine):
    machine.debian("libegl1", "libgl1-mesa-dri", "python3.11-venv", user=user)
    done = machine.install("project")
    missing = "libgl1 libxrender1"
    if user:
        assert done.returncode != 0
        assert f"sudo apt-get install -y {missing}\n" in done.stdout
        assert machine.calls() == []
    else:
        assert machine.calls()[:2] == ["apt-get update -qq", f"apt-get install -y -qq --no-install-recommends {missing}"]


def test_nothing_is_installed_that_is_there(machine):
    machine.debian(*LIBRARIES.split(), user=0)
    machine.install("project")
    assert not [call for call in machine.calls() if call.startswith("apt-get")]


def test_python_3_11_is_asked_for_where_it_is_missing(machine):
    done = machine.install("project", python="/nowhere/python3.11")
    assert done.returncode != 0
    assert "there is no /nowhere/python3.11, and the pinned packages need Python 3.11" in done.stderr
    machine.debian(*LIBRARIES.split(), user=0)
    machine.install("project", python="/nowhere/python3.11")
    assert machine.calls()[1].endswith("install -y -qq --no-install-recommends python3.11-venv")


@pytest.mark.parametrize(("what", "folder"), [("peers", ".venv-peers"), ("exports", ".venv-exports")])
def test_environments_of_others_add_to_the_projects(what, folder, machine):
    machine.install("project", venv="a 'b'")
    machine.calls()
    assert machine.install(what, venv="a 'b'").returncode == 0
    assert machine.calls()[0] == f"a 'b'/bin/python -m venv {folder}"
    added = (machine.root / folder / "packages" / "vt-pipeline.pth").read_text()
    assert added == "a 'b'/bin/../packages\n"
    machine.install(what, venv="a 'b'")
    assert machine.calls() == []


@pytest.mark.parametrize(
    ("what", "last"),
    [
        ("tacto", f".venv-peers-tacto/bin/python {PIP} --no-deps -r benchmarks/peers/requirements-tacto.txt"),
        ("blender", f".venv-showcase/bin/python {PIP} bpy==4.5.15"),
        ("hands", f".venv/bin/python {PIP} --no-deps --upgrade --target .venv-hands/hands -r benchmarks/hands/requirements.txt"),
        ("docs", f".venv/bin/python {PIP} -c constraints.txt -e .[docs]"),
    ],
)
def test_other_environments_are_made_once(what, last, machine):
    machine.install("project")
    (machine.root / ".venv-hands").mkdir()
    assert machine.install(what).returncode == 0
    assert machine.calls()[-1] == last
    assert machine.install(what).returncode == 0
    assert machine.calls() == []


def test_what_is_removed_is_an_environment(machine):
    (machine.root / "home").mkdir()
    machine.install("tacto")
    assert machine.install("remove", venv="home").returncode == 0
    assert (machine.root / "home").exists()
    assert not (machine.root / ".venv-peers-tacto").exists()
    machine.install("project", venv="mine")
    machine.install("remove", venv="mine")
    assert not (machine.root / "mine").exists()


def test_what_it_does_not_know_is_refused(machine):
    assert "there is nothing called x to install" in machine.install("x").stderr
