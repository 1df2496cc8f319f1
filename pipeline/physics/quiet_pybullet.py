"""PyBullet without its output on import and connection."""

from __future__ import annotations

import os
import sys

sys.stderr.flush()
_kept = os.dup(2)
_nowhere = os.open(os.devnull, os.O_WRONLY)
os.dup2(_nowhere, 2)  # its build time would look like a complaint
try:
    import pybullet
    from pybullet_utils.bullet_client import BulletClient
finally:
    os.dup2(_kept, 2)
    os.close(_kept)
    os.close(_nowhere)

__all__ = ["PhysicsClient", "pybullet"]


class PhysicsClient(BulletClient):  # type: ignore[misc]
    """A client without a window; `BulletClient` itself connects with empty options, for which PyBullet prints a line."""

    def __init__(self) -> None:
        self._client, self._pid = pybullet.connect(pybullet.DIRECT), os.getpid()
