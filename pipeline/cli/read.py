"""`vt-pipeline read-touch`: depth and contact in photographs of a sensor."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.markup import escape

from pipeline.cli.failures import fail
from pipeline.console import NAMED, errors, pluralise, print_line
from pipeline.errors import InvalidInput

if TYPE_CHECKING:
    from pipeline.real_touch.photograph_stream import NamedPhotograph

MM, MM2 = 1e3, 1e6


def read_touch(
    untouched: Annotated[Path, typer.Option(help="The photograph with nothing in the gel.")],
    sensor: Annotated[str, typer.Option(help="A sensor file, or the name of a shipped sensor.")],
    photographs: Annotated[Path | None, typer.Argument(help="A photograph, or a folder of them; not with --camera.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for depth, contact, normals and points; else they are printed alone.")] = None,
    model: Annotated[
        Path | None, typer.Option(help="Folder of the network; by default NAME-touch beside the sensor file, else the one that ships.")
    ] = None,
    watch: Annotated[bool, typer.Option(help="Read each photograph that appears in the folder, until Ctrl-C.")] = False,
    camera: Annotated[int | None, typer.Option(min=0, help="Number of a camera, as OpenCV counts them.")] = None,
    accept_photographs: Annotated[
        bool,
        typer.Option(
            "--accept-photographs",
            help="Read photographs that look altered: colours exchanged, turned, mirrored, grey, another exposure or sensor.",
        ),
    ] = False,
    frames: Annotated[int | None, typer.Option(min=1, help="With --watch or --camera: stop after this many photographs.")] = None,
) -> None:
    """Read depth and contact in photographs of a gel.

    A network trained on simulated presses of the sensor reads them. Those of the sensors gelsight and gelsight_mini ship; for others see
    `calibrate-sensor --train` and the stage `train-touch`.
    """
    from pipeline.formats.image_file import read_image
    from pipeline.real_touch.photograph_stream import camera_frames, photographs_of, watched
    from pipeline.real_touch.read_touch import TouchReader, write_reading

    if (photographs is None) == (camera is None):
        fail("name photographs, or a camera with --camera, one of them")
    if watch and camera is not None:
        fail("--watch is of a folder of photographs; leave it out with --camera")
    if frames is not None and not watch and camera is None:
        fail(f"--frames {frames} ends --watch or --camera; leave it out, or name the photographs to read")
    if out is not None and photographs is not None and photographs.is_dir() and out.resolve() == photographs.resolve():
        fail(f"--out {out} is the folder of the photographs, where output files would be read as photographs; name another folder")
    reader = TouchReader(sensor, read_image(untouched), model, accept_photographs=accept_photographs)
    print_line(f"read by {reader.network}")
    stream: Iterator[NamedPhotograph] | Iterator[tuple[str, Path]]
    left_out: list[str] = []
    if camera is not None:
        stream = camera_frames(camera)
    else:
        assert photographs is not None
        files = [] if watch else photographs_of(photographs, untouched)
        stream = watched(photographs, untouched) if watch else ((path.stem, path) for path in files)
    began, count, reading_seconds = time.perf_counter(), 0, 0.0
    for name, image in stream:
        start = time.perf_counter()
        try:
            reading = reader.read(read_image(image) if isinstance(image, Path) else image)
        except InvalidInput as error:  # unreadable, of another size, or altered
            if watch or camera is not None:
                errors.print(f"[yellow]warning:[/] {escape(name)} is left out: {escape(str(error))}")
            else:
                left_out.append(f"{name}: {error}")
            continue
        reading_seconds += time.perf_counter() - start
        area = MM2 * float(reading.contact.sum()) * float(np.prod(reading.sensor.pitch))
        rim = "; the rim is pressed, where depth is taken to be 0: the gel lies deeper than this" if reading.rim_pressed else ""
        print_line(f"{name}: deepest {MM * float(reading.indentation.max()):.3f} mm, contact {area:.2f} mm²{rim}")
        if out is not None:
            write_reading(reading, out, name)
        count += 1
        if count == frames:
            break
    seconds = time.perf_counter() - began
    print_line(
        f"{pluralise(count, 'photograph')}, {count / seconds:.1f} per second; reading alone {count / max(reading_seconds, 1e-9):.1f}"
    )
    if out is not None:
        print_line(f"{out}: NAME-depth.png (0.1 µm per level), NAME-contact.png, NAME-normals.png, NAME.ply, touches.zarr")
    if left_out:
        more = f"\nand {len(left_out) - NAMED} more" if len(left_out) > NAMED else ""
        raise InvalidInput(f"{pluralise(len(left_out), 'photograph')} left out:\n" + "\n".join(left_out[:NAMED]) + more)
