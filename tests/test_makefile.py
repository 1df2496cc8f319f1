"""Prerequisites in the Makefile follow the stages' inputs, and values are passed on unchanged."""

import os
import re
import shutil
import stat
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pytest

from pipeline.engine.stage import ObjectStage
from pipeline.models.families import FAMILIES, ROWS
from stages.registry import STAGES, default_location, load_stage

ROOT = Path(__file__).parents[1]


def make(*arguments: str) -> str:
    """Return the commands and rules that a dry run of make prints."""
    command = ["make", "--dry-run", "--print-data-base", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def stages_before(start: str, prerequisites: Mapping[str, Iterable[str]]) -> set[str]:
    """Find the stages among all direct and indirect prerequisites of a target."""
    reached: set[str] = set()
    waiting = list(prerequisites.get(start, ()))
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting += prerequisites.get(name, ())
    return {stage for name in reached if (stage := name.partition(".")[0]) in STAGES}


def rules_of_makefile(*arguments: str) -> dict[str, list[str]]:
    """Return the prerequisites of each target, with pattern rules expanded."""
    rules = re.findall(r"^([\w.-]+): ?(.*)$", make(*arguments), re.MULTILINE)
    return {target: prerequisites.replace("|", " ").split() for target, prerequisites in rules}


def rules_of_stages(settings: Mapping[str, dict[str, Any]]) -> dict[str, list[str]]:
    """Find the stages that make what each stage reads, with these settings."""
    loaded = {name: load_stage(name) for name in STAGES}
    chosen = {name: load_stage(name).settings_type(**settings.get(name, {})) for name in STAGES}
    makers = {stage.writes(chosen[name]): name for name, stage in loaded.items() if name != "read-grasps"}
    reads = {
        name: [*(artifact.name for artifact in stage.inputs(chosen[name])), *stage.models(chosen[name])] for name, stage in loaded.items()
    }
    return {name: [makers[artifact_name] for artifact_name in artifact_names] for name, artifact_names in reads.items()}


@pytest.mark.parametrize("configuration", [name for name, row in ROWS.items() if row.network == name and row.inputs.image != "rendering"])
def test_prerequisites_are_the_stages_inputs(configuration, tmp_path):
    chosen = {f"train-{name}": next(iter(family)) for name, family in FAMILIES.items() if name}
    chosen[f"train-{ROWS[configuration].family}"] = configuration
    trained = {name: {"configuration": value} for name, value in chosen.items()}
    read = rules_of_stages(trained | {"evaluate": {"configurations": (configuration,)}})
    targets = {name: f"{name}.0" if isinstance(load_stage(name), ObjectStage) else name for name in STAGES}
    targets |= {name: f"{name}.{value}.0" for name, value in chosen.items()} | {"evaluate": "evaluate.0"}
    rules = rules_of_makefile(*targets.values(), f"CONFIGURATIONS={configuration}", f"DATA={tmp_path}")
    for name in STAGES:
        assert stages_before(targets[name], rules) == stages_before(name, read), name


def test_grasps_may_be_read_instead_of_simulated(tmp_path):
    rules = rules_of_makefile("simulate-touch.0", "render-vision.0", "GRASPS=read-grasps", f"DATA={tmp_path}")
    for name in ("simulate-touch.0", "render-vision.0"):
        assert stages_before(name, rules) == {"read-grasps", "sample-surfaces"}


@pytest.mark.parametrize(("requested", "recorded", "shards"), [("", None, []), ("", 3, [3]), ("2", None, [2]), ("2", 3, [2])])
def test_number_of_shards_is_the_requested_one_or_that_of_the_dataset(requested, recorded, shards, tmp_path):
    if recorded is not None:
        (tmp_path / "dataset.json").write_text(f'{{"shards":{recorded}}}')
    printed = make("sample-surfaces.0", f"DATA={tmp_path}", f"SHARDS={requested}")
    assert [int(number) for number in re.findall(r"--shards (\d+)", printed)] == shards
    assert (
        len(set(re.findall(r"^dataset\.(\d+):", make("summary", f"DATA={tmp_path}", f"SHARDS={requested}"), re.MULTILINE)))
        == (shards or [1])[0]
    )


def test_all_prerequisites_have_rules():
    written = "".join((ROOT / name).read_text() for name in ("Makefile", "tools/development.mk"))
    targets = re.findall(r"^([a-z-]+):.*## ", written, re.MULTILINE)
    assert {"dataset", "test-sensors", "test-hands"} <= set(targets)
    make(*(target for target in targets if target != "reproduce"))  # reproduce runs make even in a dry run


# ---- values

CANARY = "canary"
HOSTILE = (
    *(f"'; touch {CANARY}; '", f'"; touch {CANARY}; "', f"`touch {CANARY}`", f"$(touch {CANARY})", f"$$(touch {CANARY})"),
    *(f"$(shell touch {CANARY})", f"${{shell touch {CANARY}}}", f"$(eval $(shell touch {CANARY}))", f"'$(shell touch {CANARY})'"),
    *(f"a; touch {CANARY}", f"a & touch {CANARY} &", f"|touch {CANARY}", f"> {CANARY}", f"a\ttouch {CANARY} #", f"# touch {CANARY}"),
    *("a b  c ", "a\\", "*", "~", "%", "a%b:c=d|e", "$@ $< $*", "\x1b[31m", "é\u202e", "--help", "a,b)c(", "x" * 10_000),
)
WORST = (HOSTILE[0], HOSTILE[2], HOSTILE[3], HOSTILE[8], "a b  c ", "*", "a%b:c=d|e")
FACTS = 'case $2 in *ensurepip*) echo "3.12 yes yes /usr"; exit ;; esac'  # answers the questions of tools/install.sh
PASSED = ("manifest", "preset", "data", "objects", "units", "up")


class Workplace:
    """A copy of the Makefile with programs that log their arguments."""

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


@pytest.mark.parametrize("first", range(0, len(HOSTILE), 8))
def test_values_reach_vt_pipeline_unchanged(first, workplace):
    names = (*PASSED, "set", "workers")
    values = dict(zip((name.upper() for name in names), (HOSTILE * 2)[first:], strict=False))
    assignments = [f"{name}={text}" for name, text in values.items()]
    for arguments, environment in ((assignments, {}), ([], values)):
        assert workplace.make("-n", "summary", "sample-surfaces.0", *arguments, **environment).returncode == 0
        assert workplace.calls() == []
        assert workplace.make("sample-surfaces.0", *arguments, **environment).returncode == 0
        taken = {name: value.lstrip() if arguments else value for name, value in values.items()}  # make drops leading blanks
        options = [word for name in PASSED for word in (f"--{name}", taken[name.upper()])]
        options += [word for text in taken["SET"].split() for word in ("--set", text)]
        assert workplace.calls() == [["run", "sample-surfaces", *options, "--workers", taken["WORKERS"], "--shard", "0"]]
        workplace.log.unlink()


@pytest.mark.parametrize("target", ["summary", "renderings", "test-hands"])
def test_values_reach_other_programs_unchanged(target, workplace):
    (workplace.root / ".venv-hands").mkdir()
    (workplace.root / ".venv-hands" / "installed").touch()
    value = f"'`touch {CANARY}`\" $(shell touch {CANARY}) ; touch {CANARY}"
    assert workplace.make(target, f"DATA={value}", f"MANIFEST={value}").returncode == 0
    assert value in workplace.calls()[-1]


@pytest.mark.parametrize("value", WORST, ids=lambda value: value[:30])
def test_hostile_configurations_and_seeds_run_no_other_command(value, workplace):
    for words in (["SEEDS=0", f"CONFIGURATIONS={value}"], [f"SEEDS={value}"]):
        workplace.make("-n", "report", *words)
        assert workplace.calls() == []
        workplace.make("report", *words)
        assert all(call[0] in ("run", "report") for call in workplace.calls())
        workplace.log.unlink(missing_ok=True)


@pytest.mark.parametrize("name", ["DATA", "SHARDS", "PYTHON"])
def test_value_with_a_line_break_is_refused(name, workplace):
    for arguments, environment in (((f"{name}=a\ntouch {CANARY}",), {}), ((), {name: f"a\ntouch {CANARY}"})):
        result = workplace.make("-i", "sample-surfaces.0", *arguments, **environment)
        assert result.returncode != 0
        assert f"{name} has a line break" in result.stderr
        assert workplace.calls() == []


@pytest.mark.parametrize("value", WORST, ids=lambda value: value[:30])
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


def test_hostile_targets_run_no_other_command(workplace):
    for name in (f"sample-surfaces.0;touch {CANARY}", f"sample-surfaces.`touch {CANARY}`", f"installed-';touch {CANARY};'"):
        workplace.make("-n", name)
        workplace.make(name)


@pytest.mark.parametrize("name", ["UNIT", "preset", "BIN"])
def test_unknown_variable_is_named(name, workplace):
    result = workplace.make("help", f"{name}=$(shell touch {CANARY})")
    assert result.returncode != 0
    assert f"there is no variable {name}; there are MANIFEST" in result.stderr
    assert workplace.make("help", **{name: "mm"}).returncode == 0


@pytest.mark.parametrize(
    ("words", "named"),
    [
        *((["report", f"SEEDS={seeds}"], f"SEEDS is {seeds}") for seeds in ("x", "0 1.5", "-1")),
        *((["reproduce", f"LONG={long}"], f"LONG is {long}") for long in ("0", "1 1", "%")),
        *((["-n", "reproduce", f"{name}=0"], f"reproduce has its own {name}") for name in ("MANIFEST", "OBJECTS")),
        *((["-n", "dataset", f"SHARDS={shards}"], f"SHARDS is {shards}") for shards in ("0", "10000", "x", "$(touch canary)", "'", "1 2")),
    ],
)
def test_invalid_values_stop_before_the_first_stage(words, named, workplace):
    result = workplace.make(*words)
    assert result.returncode != 0
    assert named in result.stderr
    assert workplace.calls() == []


@pytest.mark.parametrize(("target", "pages"), [("evaluate", ["--no-pages"]), ("single-image", ["--no-pages"]), ("report", ["--shipped"])])
def test_tables_are_printed_once(target, pages, workplace):
    assert workplace.make(target, "DATA=d", "SEEDS=0 1").returncode == 0
    assert [call for call in workplace.calls() if call[0] == "report"] == [["report", "d", *pages]]


def test_empty_variable_counts_as_none(workplace):
    for given in ({}, {"DATA": "", "PRESET": ""}):
        workplace.make("summary", *(f"{name}={value}" for name, value in given.items()))
        workplace.make("summary", **given)
    calls = {tuple(call) for call in workplace.calls() if call[0] == "summary"}
    assert calls == {("summary", "data/toy/draft")}


def test_configurations_are_passed_to_every_stage(workplace):
    option = ["--set", "evaluate.configurations=[toch,none]"]
    for targets in (["report"], ["train"], ["evaluate.0"], ["train-gcn.none.0", "dataset"]):
        assert workplace.make(*targets, "CONFIGURATIONS=toch none").returncode == 0
        calls = [call for call in workplace.calls() if call[0] == "run"]
        assert calls
        for call in calls:
            assert any(call[at : at + 2] == option for at in range(len(call)))
        workplace.log.unlink()


@pytest.mark.parametrize("objects", ["/tmp/my meshes/big  set", "../a.b", "..", "~/big $(set)/."])
@pytest.mark.parametrize("manifest", ["directory", "my lists/big  set.v2.yaml"])
def test_default_data_directory_is_that_of_the_command(manifest, objects, tmp_path, monkeypatch):
    (tmp_path / "a b" / "c d").mkdir(parents=True)
    workplace = Workplace(tmp_path / "a b" / "c d")
    assert workplace.make("summary", f"MANIFEST={manifest}", f"OBJECTS={objects}").returncode == 0
    monkeypatch.chdir(workplace.root)
    summary = next(call for call in workplace.calls() if call[0] == "summary")
    assert summary == ["summary", str(default_location(manifest, Path(objects)) / "draft")]


# ---- shards


@pytest.mark.parametrize("shards", ["0", "99999999999", '"3"', "null", "$(touch canary)", "'`touch canary`'", "[" * 10**6])
def test_damaged_number_of_shards_is_refused_only_where_it_is_needed(shards, workplace):
    (workplace.root / "d").mkdir()
    (workplace.root / "d" / "dataset.json").write_text(f'{{"shards": {shards}}}')
    result = workplace.make("-n", "dataset", "DATA=d")
    assert result.returncode != 0
    assert "d/dataset.json is damaged" in result.stderr
    assert workplace.make("help", "DATA=d").returncode == 0
    assert workplace.make("-n", "test", "DATA=d").returncode == 0
    assert workplace.make("-n", "dataset", "DATA=d", "SHARDS=2").returncode == 0


def test_socket_in_place_of_a_dataset_description_is_reported_by_make(workplace):
    os.mknod(workplace.root / "dataset.json", stat.S_IFSOCK | 0o600)
    assert "./dataset.json is damaged" in workplace.make("-n", "dataset", "DATA=.").stderr


def test_shards_of_a_dataset_without_its_description_or_below_home_are_all_made(workplace):
    for record in ("surfaces/0000-of-0012.json", "grasps/0011-of-0012.json"):
        (workplace.root / "d d" / record).parent.mkdir(parents=True)
        (workplace.root / "d d" / record).touch()
    numbers = re.compile("run .*render-vision .* --shards 12 --shard '([0-9]+)'")
    assert len(set(numbers.findall(workplace.make("-n", "dataset", "DATA=d d").stdout))) == 12
    assert len(set(numbers.findall(workplace.make("-n", "dataset", "DATA=~/d d", HOME=str(workplace.root)).stdout))) == 12
    (workplace.root / "d d" / "grasps" / "0000-of-0002.json").touch()
    result = workplace.make("-n", "dataset", "DATA=d d")
    assert result.returncode == 2
    assert 'd d/dataset.json is missing; write {"shards": N} into it, N as the records are named: 2, 12' in result.stderr


def test_shards_in_object_storage_are_read_by_the_installed_package(workplace):
    command = ("-n", "summary", "DATA=s3://bucket/'`touch canary`")
    workplace.program(workplace.root / ".venv" / "bin" / "python", f'[ "$3" = "s3://bucket/\'\\`touch {CANARY}\\`" ] && echo 2')
    assert len(re.findall("run .*render-vision .* --shards 2 --shard '[01]'", workplace.make(*command).stdout)) == 2
    workplace.program(workplace.root / ".venv" / "bin" / "python", "echo away >&2; exit 1")
    assert "cannot be reached" in workplace.make(*command).stderr
    (workplace.root / ".venv" / "installed").unlink()
    assert "run `make setup` first" in workplace.make(*command).stderr
    assert workplace.make("help", *command[2:]).returncode == 0
