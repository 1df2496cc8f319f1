"""`tools/install.sh` installs missing packages once and reports those that it cannot install."""

import json
import os
import re
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PYTHON = """
case $2 in *ensurepip*) echo "{version} {ensurepip} yes {prefix}"; exit ;; esac
echo "$0 $*" >>log
if [ "$2" = venv ]; then mkdir -p "$3/bin"; cp "$0" "$3/bin/python"; touch "$3/pyvenv.cfg"; fi
case $2 in *print*) mkdir -p "$(dirname "$0")/../packages"; echo "$(dirname "$0")/../packages" ;; esac
case "$*" in *"pip install"*" uv") cp programs/uv-of-pip "$(dirname "$0")/uv" ;; esac
"""
UV = 'echo "uv $*" >>log; for last; do :; done; programs/kept -m venv "$last" 2>/dev/null'
PIP_FAILS = 'if [ "$2" = pip ]; then exit 1; fi'
LIBRARIES = "libegl1 libgl1 libxrender1 libgl1-mesa-dri"
PIP = "-m pip install --quiet --disable-pip-version-check"


class Machine:
    """A repository and a system whose programs log their calls."""

    def __init__(self, root: Path) -> None:
        self.root = root
        for name in ("sh", "sed", "grep", "touch", "mkdir", "cp", "dirname", "rm"):
            (root / "programs").mkdir(exist_ok=True)
            (root / "programs" / name).symlink_to(str(shutil.which(name)))
        self.python("python3.11")
        for name in ("pyproject.toml", "constraints.txt"):
            self.write(name, age=100)

    def program(self, name: str, script: str) -> None:
        (self.root / "programs" / name).write_text(f"#!{shutil.which('sh')}\n{script}\n")
        (self.root / "programs" / name).chmod(0o755)

    def python(self, name: str, version: str | None = None, ensurepip: str = "yes", prefix: str = "/usr", more: str = "") -> None:
        facts = {"version": version or name.removeprefix("python"), "ensurepip": ensurepip, "prefix": prefix}
        self.program(name, PYTHON.format(**facts) + more)

    def debian(self, *there: str, user: int, archive: Mapping[str, str] = {}) -> None:
        self.program("dpkg-query", "\n".join(f'echo "install ok installed {name}"' for name in there) + "\nexit 1")
        self.program("id", f"echo {user}")
        self.program("apt-get", 'echo "apt-get $*" >>log')
        known = "".join(f'{name}) echo "Version: {version}" ;; ' for name, version in archive.items())
        self.program("apt-cache", f'case "$2$3" in {known} *) exit 100 ;; esac'.replace("python3)", "--no-all-versionspython3)"))

    def write(self, name: str, age: int = 0) -> None:
        (self.root / name).touch()
        now = (self.root / "programs").stat().st_mtime
        os.utime(self.root / name, (now - age, now - age))

    def install(self, what: str, venv: str = ".venv", python: str = "") -> subprocess.CompletedProcess[str]:
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
    assert machine.calls() == ["python3.11 -m venv .venv", *made]
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


def test_failed_installation_is_tried_again(machine):
    machine.python("python3.11", more=PIP_FAILS)
    for _ in range(2):
        assert machine.install("project").returncode != 0
        assert f".venv/bin/python {PIP} -c constraints.txt -e ." in machine.calls()
        assert not (machine.root / ".venv").exists()


@pytest.mark.parametrize("user", [0, 1000])
def test_missing_system_packages_are_installed_by_root_and_named_to_other_users(user, machine):
    machine.debian("libegl1", "libgl1-mesa-dri", user=user)
    done = machine.install("project")
    missing = "libgl1 libxrender1"
    if user:
        assert done.returncode != 0
        assert f"sudo apt-get install -y {missing}\n" in done.stdout
        assert machine.calls() == []
    else:
        assert machine.calls()[:2] == ["apt-get update -qq", f"apt-get install -y -qq --no-install-recommends {missing}"]


# ---- which Python


@pytest.mark.parametrize(
    ("there", "chosen"),
    [
        ({"python3": "3.12", "python3.11": "3.11"}, "python3"),
        ({"python3": "3.10", "python3.11": "3.11", "python3.12": "3.12", "python3.13": "3.13"}, "python3.13"),
        ({"python3": "3.14", "python3.11": "3.11", "python3.12": "3.12"}, "python3.12"),
        ({"python3": "2.7", "python3.11": "3.11"}, "python3.11"),
    ],
)
def test_first_suitable_python_makes_the_environment(there, chosen, machine):
    for name, version in there.items():
        machine.python(name, version)
    assert machine.install("project").returncode == 0
    assert machine.calls()[0] == f"{chosen} -m venv .venv"


@pytest.mark.parametrize("user", [0, 1000])
@pytest.mark.parametrize(
    ("python", "archive", "package"),
    [
        ("3.13", {"python3": "3.13.5-1", "python3-venv": "3.13.5-1", "python3.13-venv": "3.13.5-2"}, "python3.13-venv"),
        (None, {"python3": "3.13.5-1", "python3-venv": "3.13.5-1"}, "python3-venv"),
    ],
)
def test_package_that_completes_python_is_installed_if_available(user, python, archive, package, machine):
    (machine.root / "programs" / "python3.11").unlink()
    if python:
        machine.python("python3", python, ensurepip="no")
    machine.debian(*LIBRARIES.split(), user=user, archive=archive)
    done = machine.install("project")
    if user:
        assert f"sudo apt-get install -y {package}\n" in done.stdout
    else:
        assert machine.calls()[1] == f"apt-get install -y -qq --no-install-recommends {package}"


@pytest.mark.parametrize(
    ("python", "archive", "said"),
    [
        (None, {}, "there is no Python here"),
        ("3.12", {"python3": "3.12.3-1", "python3-venv": "3.12.3-1"}, "python3 is Python 3.12 without ensurepip"),
        ("3.14", {"python3": "3.13.5-1", "python3-venv": "3.13.5-1"}, "python3 is Python 3.14 without ensurepip"),
    ],
)
def test_missing_python_gives_a_one_line_error_with_the_remedy(python, archive, said, machine):
    (machine.root / "programs" / "python3.11").unlink()
    if python:
        machine.python("python3", python, ensurepip="no")
    machine.debian(*LIBRARIES.split(), user=0, archive=archive)
    done = machine.install("project")
    assert done.returncode != 0
    assert len(done.stderr.splitlines()) == 1
    assert f"{said}: vt-pipeline needs Python 3.11, 3.12 or 3.13 with venv" in done.stderr
    assert "make setup PYTHON=/path/to/python" in done.stderr
    assert not [call for call in machine.calls() if "install" in call]
    assert not (machine.root / ".venv").exists()


# ---- uv


@pytest.mark.parametrize(("incomplete", "source"), [(False, "3.13"), (True, "python3")])
def test_uv_makes_the_environment_if_no_python_can(incomplete, source, machine):
    (machine.root / "programs" / "python3.11").rename(machine.root / "programs" / "kept")
    if incomplete:
        machine.python("python3", "3.12", ensurepip="no")
    machine.program("uv", UV)
    assert machine.install("project").returncode == 0
    assert f"uv venv --quiet --seed --python {source} .venv" in machine.calls()


UV_CALLS = [".venv-uv/bin/python " + PIP + " -c constraints.txt uv", "uv venv --quiet --seed --python 3.13 .venv"]


@pytest.fixture
def without_suitable_python(machine):
    """Give a machine that has neither a suitable Python nor uv, which pip can install."""
    (machine.root / "programs" / "python3.11").rename(machine.root / "programs" / "kept")
    machine.program("uv-of-pip", UV)
    return machine


@pytest.mark.parametrize(
    ("name", "version"), [("python3", "3.14"), ("python3", "3.15"), ("python3", "3.9"), ("python3.14", "3.14"), ("python3.15", "3.15")]
)
def test_any_other_python_installs_uv_which_makes_the_environment(name, version, without_suitable_python):
    machine = without_suitable_python
    machine.python(name, version)
    done = machine.install("project")
    assert (done.returncode, done.stderr) == (0, "")
    assert "no Python here is 3.11, 3.12 or 3.13: installing uv into .venv-uv, which downloads Python 3.13\n" in done.stdout
    calls = machine.calls()
    assert calls[0] == f"{name} -m venv .venv-uv"
    assert [call for call in calls if "uv" in call][1:] == UV_CALLS
    assert calls[-1] == f".venv/bin/python {PIP} -c constraints.txt -e ."
    machine.install("project")
    assert machine.calls() == []
    shutil.rmtree(machine.root / ".venv")
    machine.install("project")
    assert machine.calls()[0] == UV_CALLS[1]  # with the uv that is there
    machine.install("remove")
    assert not (machine.root / ".venv-uv").exists()


@pytest.mark.parametrize(
    ("more", "uv", "said"),
    [(PIP_FAILS, UV, "uv cannot be installed"), ("", "echo error: no route >&2; exit 2", ".venv-uv/bin/uv cannot make .venv")],
)
def test_failure_of_uv_gives_the_remedy_and_leaves_no_environment(more, uv, said, without_suitable_python):
    machine = without_suitable_python
    machine.python("python3", "3.14", more=more)
    machine.program("uv-of-pip", uv)
    done = machine.install("project")
    assert done.returncode != 0
    assert f"{said}: vt-pipeline needs Python 3.11, 3.12 or 3.13 with venv" in done.stderr
    assert "make setup PYTHON=/path/to/python" in done.stderr
    assert not (machine.root / ".venv").exists()


@pytest.mark.parametrize(
    ("python", "said"), [("/nowhere/python", "there is no Python /nowhere/python"), ("python3.10", "python3.10 is Python 3.10")]
)
def test_unsuitable_python_is_refused(python, said, machine):
    machine.python("python3.10")
    machine.program("uv", 'echo "uv $*" >>log')
    done = machine.install("project", python=python)
    assert done.returncode != 0
    assert f"{said}: vt-pipeline needs Python 3.11, 3.12 or 3.13" in done.stderr
    assert machine.calls() == []


@pytest.mark.parametrize(
    ("old", "python", "said"),
    [
        ({"version": "3.10"}, "", ".venv has Python 3.10"),
        ({"version": "3.14"}, "", ".venv has Python 3.14"),
        ({"version": "3.12"}, "python3.11", ".venv has Python 3.12 of /usr, and python3.11 is Python 3.11 of /usr"),
        (
            {"version": "3.11", "prefix": "/opt/p q"},
            "python3.11",
            ".venv has Python 3.11 of /opt/p q, and python3.11 is Python 3.11 of /usr",
        ),
        (None, "", "the Python of .venv does not run"),
    ],
)
def test_environment_of_another_python_is_reported_and_made_again(old, python, said, machine):
    machine.install("project")
    machine.calls()
    if old:
        machine.python("old", **old)
        (machine.root / "programs" / "old").replace(machine.root / ".venv" / "bin" / "python")
    else:
        (machine.root / ".venv" / "bin" / "python").unlink()
        (machine.root / ".venv" / "bin" / "python").symlink_to("/nowhere/python3.11")
    done = machine.install("project", python=python)
    assert f"{said}: making it again" in done.stdout
    assert machine.calls() == ["python3.11 -m venv .venv", f".venv/bin/python {PIP} -c constraints.txt -e ."]
    machine.install("project", python=python)
    assert machine.calls() == []


def test_environment_without_pip_is_made_again(machine):
    machine.install("project")
    python = machine.root / ".venv" / "bin" / "python"
    python.write_text(python.read_text().replace("yes yes", "yes no"))
    assert ".venv has no pip: making it again" in machine.install("project").stdout


def test_folder_that_is_not_an_environment_is_not_removed(machine):
    machine.python("old", "3.10")
    (machine.root / "conda" / "bin").mkdir(parents=True)
    (machine.root / "programs" / "old").replace(machine.root / "conda" / "bin" / "python")
    done = machine.install("project", venv="conda")
    assert "conda has Python 3.10, and it is not one that could be made again: choose another VENV" in done.stderr
    assert (machine.root / "conda" / "bin" / "python").exists()


def test_environments_that_need_python_3_11_use_it_or_uv(machine):
    machine.python("python3", "3.13")
    machine.install("project", python="python3")
    machine.calls()
    assert machine.install("tacto").returncode == 0
    assert machine.calls()[0] == "python3.11 -m venv .venv-peers-tacto"
    (machine.root / "programs" / "python3.11").rename(machine.root / "programs" / "kept")
    shutil.rmtree(machine.root / ".venv-peers-tacto")
    machine.program("uv", UV)
    assert machine.install("tacto").returncode == 0
    assert machine.calls()[0] == "uv venv --quiet --seed --python 3.11 .venv-peers-tacto"


# ---- other environments


@pytest.mark.parametrize(("what", "folder"), [("peers", ".venv-peers"), ("exports", ".venv-exports")])
def test_additional_environments_extend_the_projects_environment(what, folder, machine):
    machine.program("npm", 'echo "npm $*" >>log')
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
        (
            "tactile-mnist",
            f".venv-peers-tactile-mnist/bin/python {PIP} -c constraints.txt -r benchmarks/peers/requirements-tactile-mnist.txt",
        ),
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


def test_remove_deletes_environments_only(machine):
    (machine.root / "home").mkdir()
    machine.install("tacto")
    assert machine.install("remove", venv="home").returncode == 0
    assert (machine.root / "home").exists()
    assert not (machine.root / ".venv-peers-tacto").exists()
    machine.install("project", venv="mine")
    machine.install("remove", venv="mine")
    assert not (machine.root / "mine").exists()


def test_unknown_target_is_refused(machine):
    assert "there is nothing called x to install" in machine.install("x").stderr


@pytest.mark.parametrize("name", ["Dockerfile", ".github/actions/setup/action.yml", "pipeline/checks/doctor.py"])
def test_documents_name_the_system_packages_that_are_installed(name):
    assert f"packages {LIBRARIES} $" in (ROOT / "tools" / "install.sh").read_text()
    assert LIBRARIES in (ROOT / name).read_text()


def test_supported_python_versions_are_the_same_everywhere():
    requires = re.search(r'requires-python = ">=3\.(\d+),<3\.(\d+)"', (ROOT / "pyproject.toml").read_text())
    assert requires
    versions = [f"3.{minor}" for minor in range(*map(int, requires.groups()))]
    named = f"{', '.join(versions[:-1])} or {versions[-1]}"
    for name in ("README.md", "Makefile", "docs/guide/installing.md", "docs/index.md", "tools/install.sh", "pipeline/checks/doctor.py"):
        assert named in (ROOT / name).read_text(), name
    assert f"python: {json.dumps(versions)}" in (ROOT / ".github" / "workflows" / "ci.yml").read_text()
