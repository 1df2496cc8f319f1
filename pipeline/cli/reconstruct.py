"""`vt-pipeline predict`, `demo`, `score` and `read-touch`: use trained networks, and measure other methods."""

import shlex
import time
from collections.abc import Callable, Iterable
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from typer import Argument, Option

from pipeline.cli.failures import fail
from pipeline.cli.options import DataArgument, complete_made_object
from pipeline.console import NAMED, console, pluralise, print_lines, print_warning, show_tables
from pipeline.errors import InvalidInput
from pipeline.formats.image_file import read_image
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import as_location

MM, MM2 = 1e3, 1e6
Surface = Literal["charts", "joined", "both", "closed"]


def predict(
    out: Annotated[Path, Argument(help="File to write: .obj, .ply or .glb. Metres, world frame, or the observation's; GLB: metres, y up.")],
    configuration: Annotated[
        str | None,
        Option(help="Which model of MODELS: touch, implicit-any, …; by default occluded-touch; pretrained: by the object's size."),
    ] = None,
    data: Annotated[str | None, Option(help="Data directory; with --object, instead of files.")] = None,
    models: Annotated[str | None, Option(help="Folder of models, or shipped; by default DATA/models, else the pretrained ones.")] = None,
    object_id: Annotated[str | None, Option("--object", help="Object of the data directory.", autocompletion=complete_made_object)] = None,
    grasps: Annotated[list[int] | None, Option("--grasp", min=0, help="A grasp of the object; by default 0. Repeat for several.")] = None,
    view: Annotated[int, Option(min=0, help="A rendering of the object, from 0; for single-image.")] = 0,
    observation: Annotated[
        Path | None, Option(help="YAML file of what a robot saw and felt (docs/guide/own-photographs.md); instead of --data.")
    ] = None,
    training_seed: Annotated[int, Option(min=0, help="Which training of the model, where there are several.")] = 0,
    surface: Annotated[Surface, Option(help="charts, joined (at their seams), both, or one smooth closed mesh.")] = "both",
    resolution: Annotated[int, Option(min=64, max=400, help="Edges of the closed mesh along its longest side.")] = 128,
    seed: Annotated[int, Option(min=0, help="Seed of the chart fitting.")] = 0,
) -> None:
    """Reconstruct an object from one or several grasps.

    The grasps are those of a data directory, or what an observation file describes: it is checked as a whole before anything runs.
    """
    from pipeline.reconstruct import predict as prediction

    source: prediction.Observed = observation
    if data is not None:
        if observation is not None:
            fail("give a data directory and an object, or an observation, not both")
        if object_id is None:
            fail(f"data directory {data} needs an object; name one of its objects with --object")
        source = prediction.StoredGrasps(as_location(data), object_id, grasps, view)
    elif object_id is not None or grasps or view:
        option = "--object" if object_id is not None else "--grasp" if grasps else "--view"
        fail(f"{option} is of a data directory: name --data and --object, or omit it")
    options = prediction.PredictOptions(models or None, configuration, training_seed, seed=seed, resolution=resolution)
    result = prediction.predict(out, source, options, surface)
    mesh = result.closed or result.reconstruction
    size = f"{len(mesh.vertices)} vertices, {len(mesh.faces)} faces, {result.given_places}"
    if (closed := result.closed) is not None:
        colour = f"{closed.seen.mean():.0%} coloured by the image" if closed.seen.any() else "no colour: no image shows any of it"
        size = f"closed, {size}; {colour}"
    print_lines(*result.remarks, *(f"{path}: {size}" for path in result.files))


def demo(folder: Annotated[Path, Argument(help="Folder to write to.")] = Path("demo")) -> None:
    """Reconstruct an unseen object in a robot's hand, without and with touch.

    One grasp is simulated, with a gel on each finger. A pretrained network makes closed coloured meshes, and a turntable shows that from
    image and touch beside the object.
    """
    from pipeline.reconstruct.demo import demo as show

    result = show(folder, console)
    alone, felt = result.from_image, result.from_touch
    print_lines(
        f"{result.image}: the one image, with the hand in it",
        f"{result.felt}: what the gels see; {result.touches} fingers touched",
        f"{alone.file}: from the image alone, {MM * alone.distance:.1f} mm from the object on average",
        f"{felt.file}: from image and touch, {MM * felt.distance:.1f} mm; closed, {len(felt.mesh.faces)} faces, in {felt.seconds:.0f} s",
        f"{result.turntable}: the object, and beside it the reconstruction from image and touch",
    )


def score(
    folder: Annotated[
        Path, Argument(help="Folder of OBJECT.ply, .obj, .stl, .off, .glb, … or .npy, per test object: metres, world frame.")
    ],
    data: DataArgument,
    name: Annotated[str | None, Option(help="Name of the method, in tables; by default the folder's.")] = None,
    grasps: Annotated[int, Option(min=1, help="Grasps the files were made from; more in folders grasps-N, or grasps-N-from-K, below.")] = 1,
    misplaced: Annotated[bool, Option(help="Also measure files that are far from their object, or in another unit.")] = False,
) -> None:
    """Measure another method's reconstructions as `evaluate` measures networks.

    Each file that is missing, unreadable or not in the world's frame is named, and then nothing is written.
    """
    from pipeline.tables.evaluation_tables import evaluation_tables
    from stages.evaluate.evaluation_files import METRICS
    from stages.evaluate.scores import score as measure

    directory = DataDirectory(data)
    results = directory.verified_folder(measure(folder, directory.root, console, name=name, grasps=grasps, misplaced=misplaced))
    show_tables(evaluation_tables(results))
    shown = f"`vt-pipeline report {shlex.quote(data)}` shows them beside the networks'"
    print_lines(f"{results / METRICS}: the means as JSON, with the settings; {shown}")


def read_touch(
    untouched: Annotated[Path, Option(help="The photograph with nothing in the gel.")],
    sensor: Annotated[str, Option(help="A sensor file, or the name of a built-in sensor.")],
    photographs: Annotated[Path | None, Argument(help="A photograph, or a folder of them; not with --camera.")] = None,
    out: Annotated[Path | None, Option(help="Folder for depth, contact, normals and points; else they are printed alone.")] = None,
    model: Annotated[Path | None, Option(help="Of the network; by default NAME-touch beside the sensor file, or pretrained.")] = None,
    camera: Annotated[int | None, Option(min=0, help="Number of a camera, as OpenCV counts them.")] = None,
    accept_photographs: Annotated[
        bool,
        Option(
            "--accept-photographs",
            help="Read photographs that seem altered: colours exchanged, turned, mirrored, grey, another exposure or sensor.",
        ),
    ] = False,
    frames: Annotated[int | None, Option(min=1, help="With --camera: stop after this many photographs.")] = None,
    slides: Annotated[
        bool, Option("--slides", help="Photographs follow one another, of a gel with printed dots: read shear, force and torque too.")
    ] = False,
) -> None:
    """Read depth and contact in photographs of a gel.

    A network trained on simulated presses of the sensor reads them. Pretrained networks exist for the sensors gelsight, gelsight_mini and
    digit; for others see `calibrate-sensor --train` and the stage `train-touch`.
    """
    from pipeline.kernels.touch.shear_reading import sliding
    from pipeline.real_touch import TouchReader, camera_frames, photographs_of, write_reading  # torch: seconds to import

    if (photographs is None) == (camera is None):
        fail("name photographs, or a camera with --camera, one of them")
    if frames is not None and camera is None:
        fail(f"--frames {frames} ends --camera; omit it, or name the photographs to read")
    if out is not None and photographs is not None and photographs.is_dir() and out.resolve() == photographs.resolve():
        fail(f"--out {out} is the folder of the photographs, where output files would be read as photographs; name another folder")
    reader = TouchReader(sensor, read_image(untouched), model, accept_photographs=accept_photographs, slides=slides)
    print_lines(f"read by {reader.network}")
    stream: Iterable[tuple[str, Callable[[], Any]]]
    if photographs is not None:
        stream = [(path.stem, partial(read_image, path)) for path in photographs_of(photographs, untouched)]
    else:
        stream = ((f"{count:06d}", partial(np.asarray, image)) for count, image in enumerate(islice(camera_frames(camera or 0), frames)))
    began, count, reading_seconds, failed, steps = time.perf_counter(), 0, 0.0, list[str](), list[Any]()
    for name, load in stream:
        start = time.perf_counter()
        try:
            reading = reader.read(load())
        except InvalidInput as error:  # unreadable, of another size, or altered
            if camera is not None:
                print_warning("warning:", f"{name} is skipped: {error}")
            else:
                failed.append(f"{name}: {error}")
            continue
        reading_seconds += time.perf_counter() - start
        area = MM2 * float(reading.contact.sum()) * float(np.prod(reading.sensor.pitch))
        rim = "; the rim is pressed: the gel may lie deeper than this" if reading.rim_pressed else ""
        print_lines(f"{name}: deepest {MM * float(reading.indentation.max()):.3f} mm, contact {area:.2f} mm²{rim}")
        if reading.slid is not None:
            print_lines(f"  {reading.slid}")
            steps.append((-reading.slid.shear.force[2], reading.slid.shear.friction))
        if out is not None:
            write_reading(reading, out, name)
        count += 1
    speeds = [count / max(seconds, 1e-9) for seconds in (time.perf_counter() - began, reading_seconds)]
    if count:
        print_lines(f"{pluralise(count, 'photograph')}, {speeds[0]:.1f} per second; reading alone {speeds[1]:.1f}")
    if count and out is not None:
        print_lines(f"{out}: NAME-depth.png (0.1 µm per level), NAME-contact.png, NAME-normals.png, NAME.ply, touches.zarr")
    if steps:
        friction, slid_in = sliding(*np.array(steps).T)
        there = f"; if that is all, most of the contact slides in {slid_in.sum()} of them" if count > 1 else ""
        print_lines("friction is not known: no contact shows" if np.isnan(friction) else f"friction {friction:.2f} or more{there}")
    if failed:
        more = f"\nand {len(failed) - NAMED} more" if len(failed) > NAMED else ""
        raise InvalidInput(f"{pluralise(len(failed), 'photograph')} failed:\n" + "\n".join(failed[:NAMED]) + more)
