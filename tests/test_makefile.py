"""The Makefile says in which order stages run: its prerequisites are the stages' inputs. It passes values on as they are."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pytest

from pipeline.engine.stage import ObjectStage
from pipeline.models.families import FAMILIES, GRASP_CONFIGURATIONS, family_of
from stages.registry import STAGES, load_settings_type, load_stage

ROOT = Path(__file__).parents[1]


def make(*arguments: str) -> str:
    """Return the output of a dry run of make: commands, and the rules that it works by."""
    command = ["make", "--dry-run", "--print-data-base", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def stages_before(start: str, prerequisites: Mapping[str, Iterable[str]]) -> set[str]:
    """Find the stages among all direct and indirect prerequisites of a target."""
    found: set[str] = set()
    waiting = list(prerequisites.get(start, ()))
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += prerequisites.get(name, ())
    return {stage for name in found if (stage := name.partition(".")[0]) in STAGES}


def rules_of_makefile(*arguments: str) -> dict[str, list[str]]:
    """Prerequisites by target, those of pattern rules filled in."""
    rules = re.findall(r"^([\w.-]+): ?(.*)$", make(*arguments), re.MULTILINE)
    return {target: found.replace("|", " ").split() for target, found in rules}


def rules_of_stages(settings: Mapping[str, dict[str, Any]]) -> dict[str, list[str]]:
    """Find the stages that make what each stage reads, with these settings."""
    loaded = {name: load_stage(name) for name in STAGES}
    chosen = {name: load_settings_type(name)(**settings.get(name, {})) for name in STAGES}
    makers = {stage.writes(chosen[name]): name for name, stage in loaded.items()}
    reads = {
        name: [*(artifact.name for artifact in stage.inputs(chosen[name])), *stage.models(chosen[name])] for name, stage in loaded.items()
    }
    return {name: [makers[one] for one in found] for name, found in reads.items()}


@pytest.mark.parametrize("configuration", GRASP_CONFIGURATIONS)
def test_prerequisites_are_the_stages_inputs(configuration, tmp_path):
    chosen = {f"train-{name}": next(iter(family.configurations)) for name, family in FAMILIES.items() if name}
    chosen[f"train-{family_of(configuration)}"] = configuration
    trained = {name: {"configuration": one} for name, one in chosen.items()}
    read = rules_of_stages(trained | {"evaluate": {"configurations": (configuration,)}})
    targets = {name: f"{name}.0" if isinstance(load_stage(name), ObjectStage) else name for name in STAGES}
    targets |= {name: f"{name}.{one}.0" for name, one in chosen.items()} | {"evaluate": "evaluate.0"}
    made = rules_of_makefile(*targets.values(), f"CONFIGURATIONS={configuration}", f"DATA={tmp_path}")
    for name in STAGES:
        assert stages_before(targets[name], made) == stages_before(name, read), name


@pytest.mark.parametrize(("asked", "known", "shards"), [("", None, []), ("", 3, [3]), ("2", None, [2]), ("2", 3, [2])])
def test_the_number_of_shards_is_the_one_asked_for_or_the_datasets_own(asked, known, shards, tmp_path):
    if known is not None:
        (tmp_path / "dataset.json").write_text(f'{{"shards":{known}}}')
    printed = make("sample-surfaces.0", f"DATA={tmp_path}", f"SHARDS={asked}")
    assert [int(number) for number in re.findall(r"--shards (\d+)", printed)] == shards
    assert (
        len(set(re.findall(r"^render-vision\.(\d+):", make("summary", f"DATA={tmp_path}", f"SHARDS={asked}"), re.MULTILINE)))
        == (shards or [1])[0]
    )


def test_everything_that_a_target_needs_has_a_rule():
    written = "".join((ROOT / name).read_text() for name in ("Makefile", "tools/development.mk"))
    targets = re.findall(r"^([a-z-]+):.*## ", written, re.MULTILINE)
    assert {"dataset", "test-sensors", "test-hands", "showcase"} <= set(targets)
    make(*(target for target in targets if target != "reproduce"))  # which runs make even then


# ---- values

CANARY = "canary"
HOSTILE = (
    *(f"'; touch {CANARY}; '", f'"; touch {CANARY}; "', f"`touch {CANARY}`", f"$(touch {CANARY})", f"$$(touch {CANARY})"),
    *(f"$(shell touch {CANARY})", f"${{shell touch {CANARY}}}", f"$(eval $(shell touch {CANARY}))", f"'$(shell touch {CANARY})'"),
    *(f"a; touch {CANARY}", f"a & touch {CANARY} &", f"|touch {CANARY}", f"> {CANARY}", f"a\ttouch {CANARY} #", f"# touch {CANARY}"),
    *("a b  c ", "a\\", "*", "~", "%", "a%b:c=d|e", "$@ $< $*", "\x1b[31m", "é\u202e", "--help", "a,b)c(", "x" * 10_000),
)
FACTS = 'case $2 in *ensurepip*) echo "3.12 yes yes /usr"; exit ;; esac'  # what tools/install.sh asks a Python
PASSED = ("manifest", "preset", "data", "objects", "units", "up")


class Workplace:
    """A copy of the Makefile with programs that write down what they are called with."""

    def __init__(self, root: Path) -> None:
        self.root = root
        shutil.copy(ROOT / "Makefile", root)
        shutil.copytree(ROOT / "tools", root / "tools")
        self.log = root / "log"
        self.program(root / "programs" / "dpkg-query", 'for name; do echo "install ok installed $name"; done')
        self.environment(root / ".venv")

    def program(self, path: Path, script: str) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)

    def environment(self, folder: Path) -> None:
        record = f"printf '%s\\0' \"$@\" >>'{self.log}'; echo >>'{self.log}'"
        for name in ("vt-pipeline", "python"):
            self.program(folder / "bin" / name, f"{FACTS}\n{record}")
        (folder / "installed").touch()

    def make(self, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        path = f"{self.root / 'programs'}{os.pathsep}{os.environ['PATH']}"
        plain = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
        command = ["make", *arguments]
        environment = plain | {"PATH": path} | environment
        return subprocess.run(command, cwd=self.root, env=environment, capture_output=True, text=True, check=False, timeout=60)

    def calls(self) -> list[list[str]]:
        return [line.split("\0")[:-1] for line in self.log.read_text().split("\n")[:-1]] if self.log.exists() else []


@pytest.fixture
def workplace(tmp_path):
    yield Workplace(tmp_path)
    assert not (tmp_path / CANARY).exists()


@pytest.mark.parametrize("value", HOSTILE, ids=lambda value: value[:30])
def test_a_value_reaches_programs_as_it_is(value, workplace):
    values = {name.upper(): value for name in (*PASSED, "set", "workers")}
    given = [f"{name}={one}" for name, one in values.items()]
    for arguments, environment in ((given, {}), ([], values)):
        assert workplace.make("-n", "summary", "sample-surfaces.0", *arguments, **environment).returncode == 0
        assert workplace.calls() == []
        assert workplace.make("sample-surfaces.0", *arguments, **environment).returncode == 0
        taken = value.lstrip() if arguments else value  # make itself leaves leading blanks out
        options = [word for name in PASSED for word in (f"--{name}", taken)]
        options += [word for one in taken.split() for word in ("--set", one)]
        assert workplace.calls() == [["run", "sample-surfaces", *options, "--workers", taken, "--shard", "0"]]
        workplace.log.unlink()


@pytest.mark.parametrize("target", ["summary", "renderings", "test-hands", "showcase"])
def test_values_that_other_programs_take_reach_them_as_they_are(target, workplace):
    (workplace.root / ".venv-showcase").mkdir()
    (workplace.root / ".venv-showcase" / "installed").touch()
    (workplace.root / ".venv-hands").mkdir()
    (workplace.root / ".venv-hands" / "installed").touch()
    value = f"'`touch {CANARY}`\" $(shell touch {CANARY}) ; touch {CANARY}"
    assert workplace.make(target, f"DATA={value}", f"MANIFEST={value}").returncode == 0
    assert value in workplace.calls()[-1]


@pytest.mark.parametrize("value", [one for one in HOSTILE if len(one) < 100], ids=lambda value: value[:30])
def test_names_of_networks_and_seeds_run_nothing_else(value, workplace):
    for arguments, environment in ((("report", f"CONFIGURATIONS={value}", f"SEEDS={value}"), {}), (("report",), {"SEEDS": value})):
        workplace.make("-n", *arguments, **environment)
        assert workplace.calls() == []
        workplace.make(*arguments, **environment)
        assert all(call[0] in ("run", "report") for call in workplace.calls())
        workplace.log.unlink(missing_ok=True)


@pytest.mark.parametrize("name", ["DATA", "SHARDS", "VENV", "PYTHON", "LONG", "CONFIGURATIONS"])
def test_a_value_of_two_lines_is_refused(name, workplace):
    for arguments, environment in (((f"{name}=a\ntouch {CANARY}",), {}), ((), {name: f"a\ntouch {CANARY}"})):
        done = workplace.make("-i", "sample-surfaces.0", *arguments, **environment)
        assert done.returncode != 0
        assert f"{name} has a line break" in done.stderr
        assert workplace.calls() == []


@pytest.mark.parametrize("value", [one.replace("/", "") for one in HOSTILE if len(one) < 100], ids=lambda value: value[:30])
def test_environments_may_have_any_name(value, workplace):
    (workplace.root / "x").mkdir()
    workplace.environment(workplace.root / "x" / value)
    python = workplace.root / "x" / f"{value} python"
    workplace.program(python, f'{FACTS}\ncp -r .venv "$3"; printf "%s\\0" "$@" >>{workplace.log}; echo >>{workplace.log}')
    assert workplace.make("train-unet", f"VENV=x/{value}", f"PYTHON={python}").returncode == 0
    assert [call[1] for call in workplace.calls()] == ["sample-surfaces", "simulate-grasps", "simulate-touch", "train-unet"]
    workplace.log.unlink()
    assert workplace.make("setup", f"VENV=y {value}", f"PYTHON={python}").returncode == 0
    install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-c", "constraints.txt", "-e", "."]
    assert workplace.calls() == [["-m", "venv", f"y {value}"], install]


def test_a_target_may_have_any_name(workplace):
    for name in (f"sample-surfaces.0;touch {CANARY}", f"sample-surfaces.`touch {CANARY}`", f"installed-';touch {CANARY};'"):
        workplace.make("-n", name)
        workplace.make(name)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        *(("UNIT", "UNITS"), ("MANIFET", "MANIFEST"), ("preset", "PRESET"), ("CONFIGURATION", "CONFIGURATIONS"), ("Worker", "WORKERS")),
        *(("FOO", ""), ("BIN", "")),
    ],
)
def test_a_variable_that_there_is_not_is_named(name, meant, workplace):
    done = workplace.make("help", f"{name}=$(shell touch {CANARY})")
    assert done.returncode != 0
    assert f"there is no variable {name}" in done.stderr
    assert (f", did you mean {meant}? there are MANIFEST" if meant else "; there are MANIFEST") in done.stderr
    assert workplace.make("help", **{name: "mm"}).returncode == 0


@pytest.mark.parametrize("seeds", ["x", "0 1.5", "-1", "0,1"])
def test_seeds_that_are_no_numbers_stop_before_the_first_stage(seeds, workplace):
    done = workplace.make("report", f"SEEDS={seeds}")
    assert done.returncode != 0
    assert f"SEEDS is {seeds}; it must be whole numbers" in done.stderr
    assert workplace.calls() == []


@pytest.mark.parametrize(("target", "pages"), [("evaluate", ["--no-pages"]), ("single-image", ["--no-pages"]), ("report", ["--shipped"])])
def test_tables_are_printed_once(target, pages, workplace):
    assert workplace.make(target, "DATA=d", "SEEDS=0 1").returncode == 0
    assert [call for call in workplace.calls() if call[0] == "report"] == [["report", "d", *pages]]


def test_every_stage_is_told_which_networks_are_asked_for(workplace):
    given = ["--set", "evaluate.configurations=[toch,none]"]
    for targets in (["report"], ["train"], ["evaluate.0"], ["train-gcn.none.0", "dataset"]):
        assert workplace.make(*targets, "CONFIGURATIONS=toch none").returncode == 0
        calls = [call for call in workplace.calls() if call[0] == "run"]
        assert calls
        for call in calls:
            assert any(call[at : at + 2] == given for at in range(len(call)))
        workplace.log.unlink()


# ---- shards


@pytest.mark.parametrize("shards", ["0", "-1", "1.5", "10000", "99999999999", "x", "$(touch canary)", "'", "1 2", "07"])
def test_a_number_of_shards_that_is_none_is_refused(shards, workplace):
    done = workplace.make("-n", "dataset", f"SHARDS={shards}")
    assert done.returncode != 0
    assert f"SHARDS is {shards}; it must be a whole number, 1 to 9999" in done.stderr


@pytest.mark.parametrize(
    "shards", ["0", "-1", "99999999999", "9999999", '"3"', "3.5", "null", "$(touch canary)", "'`touch canary`'", "[" * 10**6]
)
def test_a_damaged_number_of_shards_is_refused_where_it_is_needed_and_nowhere_else(shards, workplace):
    (workplace.root / "d").mkdir()
    (workplace.root / "d" / "dataset.json").write_text(f'{{"shards": {shards}}}')
    done = workplace.make("-n", "dataset", "DATA=d")
    assert done.returncode != 0
    assert "d/dataset.json is damaged" in done.stderr
    assert workplace.make("help", "DATA=d").returncode == 0
    assert workplace.make("-n", "test", "DATA=d").returncode == 0
    assert workplace.make("-n", "dataset", "DATA=d", "SHARDS=2").returncode == 0


def test_a_dataset_that_is_no_file_does_not_hold_make_up(workplace):
    os.mkfifo(workplace.root / "dataset.json")
    assert "./dataset.json is damaged" in workplace.make("-n", "dataset", "DATA=.").stderr


def test_shards_in_object_storage_are_asked_for_by_what_is_installed(workplace):
    asked = ("-n", "summary", "DATA=s3://bucket/'`touch canary`")
    workplace.program(workplace.root / ".venv" / "bin" / "python", f'[ "$3" = "s3://bucket/\'\\`touch {CANARY}\\`" ] && echo 2')
    assert len(re.findall("run 'render-vision' .* --shards 2 --shard '[01]'", workplace.make(*asked).stdout)) == 2
    workplace.program(workplace.root / ".venv" / "bin" / "python", "echo away >&2; exit 1")
    assert "cannot be reached" in workplace.make(*asked).stderr
    (workplace.root / ".venv" / "installed").unlink()
    assert "run `make setup` first" in workplace.make(*asked).stderr
    assert workplace.make("help", *asked[2:]).returncode == 0
