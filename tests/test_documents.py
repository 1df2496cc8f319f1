"""Files, functions, links, make targets, commands, options and settings named in the documents exist."""

import re
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from checks.documents import run_commands
from pipeline.cli import app
from stages.registry import STAGES, load_stage

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
ROOTS = ("", "pipeline", "docs", "stages")
"""Folders that paths in documents are below."""
GROUP: Any = typer.main.get_command(app)
COMMANDS = {name: GROUP.get_command(None, name) for name in GROUP.list_commands(None)}
MADE = ("docs/overview.png", "stages/measure_contact", "tests/stages/measure_contact", "explanations/measure_contact", "schemas/contact")
MADE += ("stages/train_ball", "networks/ball_network", "models/ball_reconstruction")
PLACEHOLDER = re.compile(r"[A-Z]{3,}|…|~|^data/|^(my_|\.work|touch/0000|out\.|poses|seen|contact-sheet|learning-curves|reconstructions)")


@cache
def make_help() -> str:
    return subprocess.run(["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def shell_of(page: Path) -> str:
    """Join the commands of a page: its shell blocks and inline code."""
    text = page.read_text().replace("\\\n", " ")
    return "\n".join([*re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL), *re.findall(r"`([^`\n]+)`", text)])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_in_documents_resolve(page):
    links = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text())
    assert not [link for link in links if "://" not in link and not (page.parent / link).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_documents_name_exist(page):
    text = page.read_text().partition("<!-- Generated below")[0]
    names = {name for name in re.findall(r"`([\w./-]+/[\w./-]*|[\w-]+\.(?:py|md|yaml|toml|cff))`", text) if not PLACEHOLDER.search(name)}
    names = {name for name in names if not any(part in name for part in MADE) and not name.startswith("models/")}
    missing = [name for name in names if not any((ROOT / root / name).exists() for root in ROOTS) and not [*ROOT.glob(f"*/*/{name}")]]
    assert not missing


def test_functions_that_architecture_names_exist():
    text = (ROOT / "docs" / "architecture.md").read_text()
    for name, function in re.findall(r"`([\w/]+\.py): ([\w.]+)`", text):
        source = "".join((ROOT / root / name).read_text() for root in ROOTS if (ROOT / root / name).exists())
        for part in function.split("."):
            assert re.search(rf"(def|class) {part}\b", source), f"{name} has no {part}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_and_options_of_documents_exist(page):
    for line in re.findall(r"vt-pipeline ([a-z][^\n#`]*)", shell_of(page)):
        name, *words = line.split()
        if name == "best-touched":  # a recipe adds it
            continue
        assert name in COMMANDS, line
        options = {option for parameter in COMMANDS[name].params for option in parameter.opts} | {"--help"}
        assert {word for word in words if word.startswith("--")} <= options, line
        for stage in words[:1] if name == "run" else ():
            assert stage in STAGES or stage in ("STAGE", "measure-contact"), line


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_targets_of_make_and_settings_in_documents_exist(page):
    shell = shell_of(page)
    targets, variables = set(re.findall(r"make ([\w-]+)", make_help())), {*re.findall(r"([A-Z]+)=", make_help()), "VENV", "PYTHON"}
    for line in re.findall(r"(?:^|\n)make ([^\n#]*)", shell):
        words = re.sub(r'"[^"]*"', "", line).split()
        assert {word for word in words if re.fullmatch("[a-z][a-z-]*", word)} <= targets, line
        assert {word.partition("=")[0] for word in words if "=" in word} <= variables, line
    for stage, setting in re.findall(rf"\b({'|'.join(STAGES)})\.([a-z_]+)", shell):
        assert setting in load_stage(stage).settings_type.model_fields, f"{stage}.{setting}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_in_documents_are_run_or_listed_as_not_run(page):
    name = page.relative_to(ROOT).as_posix()
    assert not run_commands.commands(name) or name in {*run_commands.PAGES, *run_commands.NOT_RUN_PAGES}


def test_every_reason_not_to_run_a_command_matches_a_command():
    printed = [command for page in run_commands.PAGES for command in run_commands.commands(page)]
    assert {pattern for command in printed for pattern in run_commands.reasons(command)} == set(run_commands.NOT_RUN)


@pytest.mark.parametrize("stage", STAGES)
def test_every_stage_has_a_page_with_a_small_picture(stage):
    pages = [
        page for page in (ROOT / "docs" / "how-it-works").glob("*.md") if stage in re.findall(r"[\w-]+", page.read_text().splitlines()[0])
    ]
    (picture,) = re.findall(r"^!\[.{20,}\]\((.*)\)$", pages[0].read_text(), re.MULTILINE)
    assert 3_000 < (pages[0].parent / picture).stat().st_size < 60_000
    assert f"how-it-works/{pages[0].name}" in (ROOT / "mkdocs.yml").read_text()


def test_readme_is_short_and_starts_with_a_picture():
    lines = (ROOT / "README.md").read_text().splitlines()
    assert len(lines) < 120
    assert lines[2].startswith("![")
    assert (ROOT / "docs" / "overview.png").stat().st_size < 300_000


def test_workflow_runs_the_commands_of_this_repository():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())
    runs = [step.get("run", "") for job in workflow["jobs"].values() for step in job["steps"]]
    assert ".ci/run" in runs
    assert "test-slow" in workflow["jobs"]["nightly"]["strategy"]["matrix"]["target"]
