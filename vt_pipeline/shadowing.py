"""Check that the packages this one builds on are ours: their names are common, and a user's project may have its own."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

OURS = ("pipeline", "stages", "schemas")


def refuse_shadows(root: Path) -> None:
    """Raise an `ImportError` that names the package and its place, where one of `OURS` is not in the folder `root`."""
    for name in OURS:
        spec = find_spec(name)
        place = Path(spec.origin or next(iter(spec.submodule_search_locations or [""]))) if spec else None
        if place is None or root.resolve() not in place.resolve().parents:
            raise ImportError(
                f"vt_pipeline needs its own package {name!r} in {root}, but Python finds {place or 'none'}: a file or folder of your "
                f"project hides it. Rename that, or start Python from another folder: what is first on sys.path is found"
            )
