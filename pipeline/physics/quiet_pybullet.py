"""PyBullet without its output on import and connection."""

import os
import sys

sys.stderr.flush()
_stderr = os.dup(2)
_null = os.open(os.devnull, os.O_WRONLY)
os.dup2(_null, 2)  # its build time would look like a warning
try:
    import pybullet
    from pybullet_utils.bullet_client import BulletClient
finally:
    os.dup2(_stderr, 2)
    os.close(_stderr)
    os.close(_null)

__all__ = ["PhysicsClient", "pybullet"]


class PhysicsClient(BulletClient):  # type: ignore[misc]
    """A client without a window; `BulletClient` itself connects with empty options, for which PyBullet prints a line."""

    def __init__(self) -> None:
        self._client, self._pid = pybullet.connect(pybullet.DIRECT), os.getpid()
