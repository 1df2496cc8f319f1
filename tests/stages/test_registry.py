"""The table of stages: trades are listed, and no stage needs torch before it computes."""

import subprocess
import sys
from importlib import import_module

from stages.registry import GRASP_STAGES, STAGES, TRADED


def test_stages_with_a_trade_are_listed() -> None:
    assert tuple(name for name in GRASP_STAGES if hasattr(import_module(STAGES[name].module), "TRADE")) == TRADED


def test_loading_all_stages_imports_no_torch() -> None:
    code = "import sys; from stages.registry import BUILT_IN, load_stage; all(map(load_stage, BUILT_IN)); print('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
