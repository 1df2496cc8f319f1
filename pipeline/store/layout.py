"""Where things lie in a data directory."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_SHARD = re.compile(r"(\d{4,})\.zarr")


@dataclass(frozen=True)
class Layout:
    """The paths below a data directory: `NAME/NNNN.zarr` for finished shards, `.work` for what is being made."""

    root: Path

    def shard(self, artifact: str, number: int) -> Path:
        """The place of a finished shard."""
        return self.root / artifact / f"{number:04d}.zarr"

    def shards(self, artifact: str) -> list[tuple[int, Path]]:
        """The shards of an artifact that stand under their name, in order."""
        found = [(_SHARD.fullmatch(path.name), path) for path in (self.root / artifact).glob("*.zarr")]
        return sorted((int(match[1]), path) for match, path in found if match)

    def work(self, artifact: str) -> Path:
        """Where the pieces and half-written shards of an artifact lie until they are whole."""
        return self.root / ".work" / artifact

    def artifacts(self) -> list[str]:
        """Names of the artifacts that have a shard here."""
        return sorted({path.parent.name for path in self.root.glob("*/*.zarr") if _SHARD.fullmatch(path.name)})
