"""The table of stages: trades are listed, and no stage needs torch before it computes."""

import subprocess
import sys
from importlib import import_module

from stages.registry import BUILT_IN, GRASP_STAGES, STAGES, TRADED, load_stage


def test_stages_with_a_trade_are_listed() -> None:
    assert tuple(name for name in GRASP_STAGES if hasattr(import_module(STAGES[name].module), "TRADE")) == TRADED


def test_loading_stages_imports_none_of_the_libraries_that_compute() -> None:
    code = "import sys; from stages.registry import *; [*map(load_stage, {})]; print([*sys.modules])"
    code = f"{code.format('DATASET')}; {code.format('BUILT_IN')}"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    dataset, every = printed.splitlines()
    assert not [name for name in ("numba", "trimesh", "torch", "pybullet", "scipy.spatial") if f"'{name}'" in dataset]
    assert "'torch'" not in every


def test_stages_come_after_all_that_write_what_they_read() -> None:
    settings = {name: load_stage(name).settings_type() for name in BUILT_IN}
    written = {name: load_stage(name).writes(settings[name]) for name in BUILT_IN}
    for position, name in enumerate(BUILT_IN):
        later = {written[other] for other in list(BUILT_IN)[position:]}
        assert not later & set(load_stage(name).reads(settings[name])), name
