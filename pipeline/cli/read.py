"""`vt-pipeline read-touch`: depth and contact in photographs of a sensor."""

import time
from collections.abc import Callable, Iterable
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.markup import escape

from pipeline.cli.failures import fail
from pipeline.console import NAMED, errors, pluralise, print_line
from pipeline.errors import InvalidInput
from pipeline.formats.image_file import read_image

MM, MM2 = 1e3, 1e6


def read_touch(
    untouched: Annotated[Path, typer.Option(help="The photograph with nothing in the gel.")],
    sensor: Annotated[str, typer.Option(help="A sensor file, or the name of a built-in sensor.")],
    photographs: Annotated[Path | None, typer.Argument(help="A photograph, or a folder of them; not with --camera.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for depth, contact, normals and points; else they are printed alone.")] = None,
    model: Annotated[
        Path | None, typer.Option(help="Folder of the network; by default NAME-touch beside the sensor file, else the pretrained one.")
    ] = None,
    camera: Annotated[int | None, typer.Option(min=0, help="Number of a camera, as OpenCV counts them.")] = None,
    accept_photographs: Annotated[
        bool,
        typer.Option(
            "--accept-photographs",
            help="Read photographs that seem altered: colours exchanged, turned, mirrored, grey, another exposure or sensor.",
        ),
    ] = False,
    frames: Annotated[int | None, typer.Option(min=1, help="With --camera: stop after this many photographs.")] = None,
) -> None:
    """Read depth and contact in photographs of a gel.

    A network trained on simulated presses of the sensor reads them. Pretrained networks exist for the sensors gelsight and gelsight_mini;
    for others see `calibrate-sensor --train` and the stage `train-touch`.
    """
    from pipeline.real_touch.read_touch import TouchReader, camera_frames, photographs_of, write_reading  # torch: seconds to import

    if (photographs is None) == (camera is None):
        fail("name photographs, or a camera with --camera, one of them")
    if frames is not None and camera is None:
        fail(f"--frames {frames} ends --camera; omit it, or name the photographs to read")
    if out is not None and photographs is not None and photographs.is_dir() and out.resolve() == photographs.resolve():
        fail(f"--out {out} is the folder of the photographs, where output files would be read as photographs; name another folder")
    reader = TouchReader(sensor, read_image(untouched), model, accept_photographs=accept_photographs)
    print_line(f"read by {reader.network}")
    stream: Iterable[tuple[str, Callable[[], NDArray[np.uint8]]]]
    if photographs is not None:
        stream = [(path.stem, partial(read_image, path)) for path in photographs_of(photographs, untouched)]
    else:
        stream = ((f"{count:06d}", partial(np.asarray, image)) for count, image in enumerate(islice(camera_frames(camera or 0), frames)))
    began, count, reading_seconds = time.perf_counter(), 0, 0.0
    failed: list[str] = []
    for name, load in stream:
        start = time.perf_counter()
        try:
            reading = reader.read(load())
        except InvalidInput as error:  # unreadable, of another size, or altered
            if camera is not None:
                errors.print(f"[yellow]warning:[/] {escape(name)} is skipped: {escape(str(error))}")
            else:
                failed.append(f"{name}: {error}")
            continue
        reading_seconds += time.perf_counter() - start
        area = MM2 * float(reading.contact.sum()) * float(np.prod(reading.sensor.pitch))
        rim = "; the rim is pressed, where depth is taken to be 0: the gel lies deeper than this" if reading.rim_pressed else ""
        print_line(f"{name}: deepest {MM * float(reading.indentation.max()):.3f} mm, contact {area:.2f} mm²{rim}")
        if out is not None:
            write_reading(reading, out, name)
        count += 1
    seconds = time.perf_counter() - began
    print_line(
        f"{pluralise(count, 'photograph')}, {count / seconds:.1f} per second; reading alone {count / max(reading_seconds, 1e-9):.1f}"
    )
    if out is not None:
        print_line(f"{out}: NAME-depth.png (0.1 µm per level), NAME-contact.png, NAME-normals.png, NAME.ply, touches.zarr")
    if failed:
        more = f"\nand {len(failed) - NAMED} more" if len(failed) > NAMED else ""
        raise InvalidInput(f"{pluralise(len(failed), 'photograph')} failed:\n" + "\n".join(failed[:NAMED]) + more)
