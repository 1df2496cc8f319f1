"""The Makefile says in which order stages run: its prerequisites are the stages' inputs. And it knows the number of shards."""

from __future__ import annotations

import re
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
    """What make would run, and the rules it works by."""
    command = ["make", "--dry-run", "--print-data-base", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def stages_before(start: str, prerequisites: Mapping[str, Iterable[str]]) -> set[str]:
    """The stages among everything that must be made before a target."""
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
    """The stages that make what each stage reads, with these settings."""
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
    targets = [target for target in re.findall(r"^([a-z-]+):.*## ", (ROOT / "Makefile").read_text(), re.MULTILINE)]
    assert {"dataset", "test-sensors", "test-hands", "showcase"} <= set(targets)
    make(*targets)


def test_a_number_of_shards_that_is_none_is_refused(tmp_path):
    done = subprocess.run(["make", "-n", "dataset", "SHARDS=0"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "SHARDS is 0; it must be a whole number" in done.stderr
