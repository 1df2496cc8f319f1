"""What TACTO 0.0.3 needs to run with numpy 2 and Python 3.11, restored from outside: no installed file is edited.

As published, `pip install tacto==0.0.3` brings urdfpy 0.0.22, which pins networkx 2.2, which imports `collections.Mapping`, gone
since Python 3.10. `requirements-tacto.txt` therefore installs current networkx and PyOpenGL, without asking for the pins. What is left
is numpy's aliases: urdfpy and TACTO use `np.float`, pyrender 0.1.45 `np.infty`, gone since numpy 1.24 and 2.0.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

ALIASES: dict[str, Any] = {"float": float, "infty": np.inf}


def restore() -> list[str]:
    """Put the aliases back and choose EGL; to be called before `tacto` is imported. Returns what was missing."""
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    missing = [name for name in ALIASES if name not in vars(np)]
    for name in missing:
        setattr(np, name, ALIASES[name])
    return missing
