"""The record of libraries and processor."""

import json
import os
import platform
import subprocess
import sys

import numpy as np

from checks.processors import environment
from pipeline.store.record import library_versions, processor


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
