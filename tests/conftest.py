"""Shared parts of tests: hypothesis profiles, and meshes with known answers.

Tests with hypothesis try a few examples in `make test` and many in `make test-slow`, which loads the profile `thorough`. The examples
follow from the test alone, and no clock decides.
"""

import gc
import os
import signal
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, settings

from pipeline.kernels.geometry.mesh import Mesh

HERE = Path(__file__).parent
SHORT = {"kernels", "formats"}
"""Folders whose files take seconds."""

settings.register_profile("quick", max_examples=15, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("thorough", settings.get_profile("quick"), max_examples=500)
settings.load_profile("quick")


def pytest_configure() -> None:
    """Compute on one thread per process; restore Ctrl-C, which a background job of a shell ignores, for programs that tests interrupt;
    do not wait for disks."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    os.fsync = lambda file: None  # half the time of tests that write datasets


def pytest_collection_finish() -> None:
    """Spare the garbage collector what the imports have made."""
    gc.freeze()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the longest file first, then those of whole runs, and kernels and readers last: no process waits for another's last file."""
    items.sort(key=lambda item: (item.path.name != "test_pipeline.py", item.path.parent != HERE, bool(SHORT & {*item.path.parts})))


def mesh_of(*parts: trimesh.Trimesh) -> Mesh:
    """Join shapes of trimesh into one mesh."""
    whole = trimesh.util.concatenate(parts)
    return Mesh.bare(whole.vertices, whole.faces)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)
