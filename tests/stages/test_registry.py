"""The table of stages: trades are listed, and no stage needs torch before it computes."""

import subprocess
import sys
from importlib import import_module

from stages.registry import GRASP_STAGES, STAGES, TRADED


def test_stages_with_a_trade_are_listed() -> None:
    assert tuple(name for name in GRASP_STAGES if hasattr(import_module(STAGES[name].module), "TRADE")) == TRADED


def test_loading_stages_imports_none_of_the_libraries_that_compute() -> None:
    code = "import sys; from stages.registry import *; [*map(load_stage, {})]; print([*sys.modules])"
    code = f"{code.format('DATASET')}; {code.format('BUILT_IN')}"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    dataset, every = printed.splitlines()
    assert not [name for name in ("numba", "trimesh", "torch", "pybullet", "scipy.spatial") if f"'{name}'" in dataset]
    assert "'torch'" not in every
