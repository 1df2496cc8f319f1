"""Rows record the kind of processor that computed them; several kinds in an artifact are marked and fail a strict check."""

import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from checks.processors import environment
from pipeline.engine import executor
from pipeline.store.record import library_versions, processor, processor_kind
from schemas.catalogue import ARTIFACTS
from tests.command_line import invoke, vt
from tests.engine.tiny_stages import NOISE, digest, published, request, run

HERE = processor_kind(processor())
OTHER = {"machine": "x86_64", "model": "Other CPU", "numpy": ["X86_V2", "X86_V3"]}
OTHER_KIND = "Other CPU, x86_64, X86_V2 X86_V3"


@pytest.fixture(scope="module", autouse=True)
def noise_in_catalogue() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ARTIFACTS, "noise", NOISE)
        yield


@pytest.fixture
def mixed_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make five rows in one shard, two of them computed by another kind of processor."""
    with monkeypatch.context() as patch:
        patch.setattr(executor, "processor", lambda: OTHER)
        for name in "ab":
            run(request(tmp_path, only=name))
    run(request(tmp_path))
    return tmp_path


def test_several_kinds_of_processors_are_marked_and_fail_a_strict_check_alone(mixed_data: Path, tmp_path_factory) -> None:
    other = tmp_path_factory.mktemp("alone")
    run(request(other))
    assert published(other).processors() == {HERE: 5}
    assert digest(mixed_data) == digest(other)
    vt("validate", "--strict", str(other))
    assert published(mixed_data).processors() == {HERE: 3, OTHER_KIND: 2}
    code, text = invoke("status", str(mixed_data))
    assert (code, text.count("computed by several kinds of processors")) == (0, 1)
    vt("validate", str(mixed_data))
    text = vt("validate", "--strict", str(mixed_data), fails=True)
    assert f"2 kinds of processors ({HERE}: 3 rows; {OTHER_KIND}: 2 rows)" in text
    assert run(request(mixed_data, count=6)) == 1  # the other rows are packed again with their records
    assert published(mixed_data).processors() == {HERE: 4, OTHER_KIND: 2}


def test_record_holds_library_versions_and_the_machine() -> None:
    assert library_versions()["numpy"] == np.__version__
    assert processor()["machine"] == platform.machine()


def test_record_holds_the_instruction_sets_of_numpy_and_torch() -> None:
    code = "import json, torch; from pipeline.store.record import processor; print(json.dumps(processor()))"
    run = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **environment("prescott")}, capture_output=True, text=True, check=True
    )
    recorded = json.loads(run.stdout)
    assert recorded["torch"] == "DEFAULT"
    assert not set(environment("prescott")["NPY_DISABLE_CPU_FEATURES"].split()) & set(recorded["numpy"])
