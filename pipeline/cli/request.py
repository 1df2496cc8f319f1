"""What commands that run stages have in common: their options, and the request made of them."""

from __future__ import annotations

import os
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from pipeline.cli.messages import fail
from pipeline.config.manifest import load_manifest
from pipeline.config.presets import load_presets
from pipeline.engine.plan import Request
from pipeline.engine.stage import Stage
from pipeline.errors import PipelineError
from stages.registry import resolve

S = TypeVar("S", bound=Stage)

ManifestOption = Annotated[str, typer.Option(help="A built-in manifest, or the path of a YAML file.")]
PresetOption = Annotated[str, typer.Option(help=f"One of {', '.join(load_presets())}.")]
DataOption = Annotated[Path | None, typer.Option(help="Data directory; by default data/MANIFEST/PRESET, or data/MANIFEST-OBJECTS/PRESET.")]
ObjectsOption = Annotated[Path | None, typer.Option(help="Folder of meshes, for manifests that name none.")]
SetOption = Annotated[list[str] | None, typer.Option("--set", help="STAGE.SETTING=VALUE, or SETTING=VALUE wherever there is one.")]
SeedOption = Annotated[int | None, typer.Option(min=0, help="Root seed, instead of the manifest's.")]


@contextmanager
def failures_as_words() -> Iterator[None]:
    """Whatever a person can mend ends the command with words for it."""
    try:
        yield
    except (PipelineError, OSError) as error:
        fail(error)
    except KeyboardInterrupt:
        fail("interrupted; what is finished is kept, run the same command to continue")
    except typer.Exit:
        raise
    except Exception:
        traceback.print_exc()
        fail("this is a bug in vt-pipeline; please report it with the traceback above. What is finished is kept")


def make_request(
    stage: S,
    manifest: str,
    preset: str,
    data: Path | None,
    objects: Path | None,
    assignments: Sequence[str],
    seed: int | None,
    *,
    workers: int = 0,
    **options: Any,
) -> Request[S]:
    """Turn what every command's options say into a request; `options` are its other fields."""
    if (where := data or _default_place(manifest, objects) / preset).is_file():
        fail(f"--data {where} is a file; name a folder")
    described = load_manifest(manifest)
    return Request(
        stage=stage,
        settings=resolve(stage.name, preset, assignments),
        manifest=described.name,
        objects=described.objects(objects),
        preset=preset,
        seed=described.seed if seed is None else seed,
        data=where,
        workers=workers or len(os.sched_getaffinity(0)),
        **options,
    )


def _default_place(manifest: str, objects: Path | None) -> Path:
    """A folder of meshes goes by its name: two of them do not share a data directory."""
    return Path("data") / (Path(manifest).stem + (f"-{objects.absolute().name}" if objects else ""))
