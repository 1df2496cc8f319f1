"""Score depth that is read in photographs of real sensors: `make bench-touch REAL=FOLDER`."""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.provenance import commit, machine
from benchmarks.real_touch.baselines import Slopes, depth_of, look_up_table, per_pixel_network
from benchmarks.real_touch.ours import calibrated_sensor
from benchmarks.real_touch.photograph_sets import SETS, PhotographSet, distances, read_sets
from benchmarks.real_touch.pictures import draw_presses
from benchmarks.real_touch.scores import Reading, Scores, ball_footprint, ball_radius, mean_scores, score
from benchmarks.timing import Table
from pipeline.kernels.touch.sensor import MM
from pipeline.models.touch_model import LocalTouchModel, load_touch_model
from pipeline.real_touch import save_sensor_network, train_sensor_network

COLUMNS = ["RMSE, mm", "mean error, mm", "RMSE without the mean error, mm", "normals on balls, °", "on flats, °", "contact, IoU"]
Method = Callable[[NDArray[np.uint8]], Reading]
AROUND, NEAR = (0.0, 0.5, 1.0, 1.25, 1.5, 2.0, 3.0), 0.1
"""Contact radii from a ball's middle at which depth is tabulated, and by how much pixels may differ from them."""
OURS = "ours, trained on simulation"
PAGE_HEAD = """# Depth in photographs of real sensors

Written by `make bench-touch REAL=FOLDER`: {}. FOLDER holds clones of {}; they have no licence that lets
photographs be shipped, so pictures here show depth alone.

Depth is how far the gel's surface lies below its rest. It is compared in the footprint of each press: of a ball, 0.85 of the circle in
which it would meet a flat gel; of a flat face, its outline. Truth is nominal: a rigid ball, or one depth. The contact's intersection over
union is taken with that footprint, and for balls of unknown depth with their circle as `calibrate-sensor` finds it. Normals on flats are
compared 0.3 mm from the outline on. For balls of unknown depth the shape alone is compared.

"""
PAGE_END = """
- **Look-up table**: the mean slope of each bin of four levels per colour, of all pixels in the contacts of the balls; slopes are
  integrated by Poisson's equation, and what lies above the rest is cut.
- **Per-pixel network**: 8,834 parameters, from change of colour and position to slopes; fitted to the same pixels.
  Both read the photographs as they are; ours first takes away the drift of the light.
- **Ours**: `calibrate-sensor` fits a sensor file to the photographs of the same balls; `train-touch` then learns from random simulated
  presses of that sensor. The network itself sees no photograph. The worst press of a mean is that of all seeds.
- The table of the gel around the balls shows how far it is drawn in by the colours of contacts alone, where slopes are known (look-up
  table), and as ours reads it.
- Settings were chosen by balls alone: by photographs that a calibration leaves out, by the table of the gel around the balls, and by
  normals in their contacts. The presses of known depth were scored with a thick gel (0.132 mm, too deep), with a thin one (0.069 mm), at
  commit 5fe899d (0.066 mm), and after each later change of how photographs are read, to see that they had become no worse. Before
  5fe899d the balls had shown three faults: the flat middle of a contact is lit otherwise than the untouched gel, light drifts between
  photographs, and gentle slopes were read too steep.
- With today's circles of the Mini's balls, which are 7 to 10 % smaller than at commit 5fe899d, all methods read shapes and normals better
  than then, and radii 6 to 19 % too small; ours were 1 to 7 % too large.
- Times are the least processor time of all photographs; other work on the machine makes them longer.
- Depth is free where the rim is pressed, and light that falls off in a corner may be read as a press there: the cards of the shipped
  networks (`make sensor-weights REAL=FOLDER`) have, as `stray`, the share of photographs in which contact more than a quarter of its
  radius beyond the ball's circle covers over a tenth of it. `read-touch` says which photographs show a press at the rim.
- The same figures for your photographs: describe them as in `benchmarks/real_touch/sets/`, and add `--set FILE`; or write depths in mm as
  `FOLDER/SET/PRESS.npy` (and contacts as `PRESS-contact.npy`) and add `--predictions FOLDER`.
"""


def methods(photographs: PhotographSet, seeds: range, models: Path | None) -> Iterator[tuple[str, Method]]:
    """Fit each method with each seed that it depends on."""
    yield "look-up table, real balls", integrated(look_up_table(photographs), photographs)
    for seed in seeds:
        yield f"per-pixel network, real balls, seed {seed}", integrated(per_pixel_network(photographs, seed), photographs)
    sensor = None
    for seed in seeds:
        folder = models and models / f"{photographs.name}-{seed}"
        if folder and (folder / "model.json").is_file():
            model = load_touch_model(folder, "cpu")
        else:
            sensor = sensor or calibrated_sensor(photographs)
            began = time.perf_counter()
            model, facts = train_sensor_network(sensor, seed=seed)
            print(f"{photographs.name}: trained {facts['parameters']} parameters in {time.perf_counter() - began:.0f} s", flush=True)
            if folder:
                save_sensor_network(model, folder)
        assert isinstance(model, LocalTouchModel)
        yield f"{OURS}, seed {seed}", read_by(model, photographs)


def integrated(slopes: Slopes, photographs: PhotographSet) -> Method:
    """Make a method that integrates slopes to depth."""
    return lambda image: Reading(depth_of(slopes(image), photographs.mm_per_pixel))


def read_by(model: LocalTouchModel, photographs: PhotographSet) -> Method:
    """Make a method that reads with a trained network."""

    def read(image: NDArray[np.uint8]) -> Reading:
        indentation, contact, _ = model.read(image[None], photographs.untouched)
        return Reading(MM * indentation[0].astype(float), contact[0])

    return read


def compare(photographs: PhotographSet, results: list[tuple[str, list[Reading]]], least_ms: dict[str, float]) -> Table:
    """Tabulate each method's means, the worst press, and the least processor milliseconds per photograph."""
    left_out = f"{len(photographs.not_found)} photographs are left out, as their contact was not found." if photographs.not_found else ""
    note = f"{len(photographs.balls)} balls to fit to, {len(photographs.presses)} presses to test on. {left_out}"
    table = Table(photographs.name, [*COLUMNS, "worst press, mm", "ms per photograph"], [note.strip()])
    by_kind: dict[str, list[Scores]] = {}
    for name, readings in results:
        scores = scores_of(readings, photographs)
        table.add(name, *cells(mean_scores(scores)), number(worst(scores)), f"{least_ms[name]:.1f}" if name in least_ms else "–")
        by_kind.setdefault(name.rpartition(", seed")[0], []).extend(scores)
    for method, scores in by_kind.items():
        if method:
            table.add(f"**{method}, mean**", *cells(mean_scores(scores)), number(worst(scores)), "")
    return table


def drawn_in(photographs: PhotographSet, methods_by_name: dict[str, Method]) -> Table:
    """Tabulate the depth that methods read around the balls they were fitted to, mm, by distance in contact radii."""
    table = Table(f"{photographs.name}: the gel around the balls", [f"{distance:g}" for distance in AROUND])
    for name, method in methods_by_name.items():
        rows = []
        for ball in photographs.balls:
            depth, circle = method(ball.image).depth, ball.contact
            share = distances(depth.shape, circle.x, circle.y) / circle.radius
            rows.append([depth[np.abs(share - distance) < NEAR].mean() for distance in AROUND])
        table.add(name, *(number(value) for value in np.mean(rows, axis=0).tolist()))
    return table


def radii(photographs: PhotographSet, results: list[tuple[str, list[Reading]]]) -> Table:
    """Tabulate the radius that each method recovers of the tested balls of unknown depth."""
    table = Table(f"{photographs.name}: radius of the balls", ["true, mm", "median, mm", "within 10 %", "within 25 %"])
    for name, readings in results:
        pairs = zip(readings, photographs.presses, strict=True)
        read_radii = np.array(
            [ball_radius(reading.depth, ball_footprint(reading, press), photographs.mm_per_pixel) for reading, press in pairs]
        )
        deviation = np.abs(read_radii / photographs.tested_radius - 1)
        shares = [f"{100 * float((deviation < limit).mean()):.0f} %" for limit in (0.1, 0.25)]
        table.add(name, number(photographs.tested_radius), number(float(np.median(read_radii)), 2), *shares)
    return table


def scores_of(readings: list[Reading], photographs: PhotographSet) -> list[Scores]:
    """Score the readings of all presses."""
    pairs = zip(readings, photographs.presses, strict=True)
    return [score(reading, press, photographs.mm_per_pixel) for reading, press in pairs]


def worst(scores: list[Scores]) -> float:
    """Find the largest RMSE, or error of shape."""
    return max(entry.shape if np.isnan(entry.rmse) else entry.rmse for entry in scores)


def cells(scores: Scores) -> list[str]:
    """Format scores."""
    return [number(getattr(scores, field.name), 3 if field.name in ("rmse", "bias", "shape") else 2) for field in fields(Scores)]


def number(value: float, digits: int = 3) -> str:
    """Format a number; a dash where there is none."""
    return "–" if np.isnan(value) else f"{value:.{digits}f}"


def predicted(folder: Path, photographs: PhotographSet) -> list[Reading]:
    """Read predictions of a set from files."""
    readings = []
    for press in photographs.presses:
        path = folder / photographs.name / f"{press.name.replace('/', '_')}.npy"
        contact = path.with_name(f"{path.stem}-contact.npy")
        depth = np.load(path).astype(float)
        if depth.shape != press.depth.shape:
            raise SystemExit(f"{path} is {depth.shape}, the photograph {press.depth.shape}")
        readings.append(Reading(depth, np.load(contact).astype(bool) if contact.is_file() else None))
    return readings


def main() -> None:
    """Fit, read, score, print and write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real_touch", description=__doc__)
    parser.add_argument("real", type=Path, help="folder of the clones")
    parser.add_argument("--set", type=Path, action="append", help="description of another set; several times for several")
    parser.add_argument("--only", help="name of the one set to score")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--models", type=Path, help="folder that keeps trained networks, which a later run loads")
    parser.add_argument("--predictions", type=Path, help="score these alone")
    parser.add_argument("--write", type=Path, help="page to write")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    sets = [
        entry for entry in read_sets(arguments.real, arguments.set or sorted(SETS.glob("*.yaml"))) if arguments.only in (None, entry.name)
    ]
    pages = []
    for photographs in sets:
        if arguments.predictions:
            results = [("predictions", predicted(arguments.predictions, photographs))]
            least_ms: dict[str, float] = {}
            first_methods: dict[str, Method] = {}
        else:
            results, least_ms, first_methods = [], {}, {}
            for name, method in methods(photographs, range(arguments.seeds), arguments.models):
                readings, times = [], []
                for press in photographs.presses:
                    start = time.process_time()
                    readings.append(method(press.image))
                    times.append(1e3 * (time.process_time() - start))
                results.append((name, readings))
                least_ms[name] = min(times)
                first_methods.setdefault(name.partition(", seed")[0], method)
        tables = [compare(photographs, results, least_ms)]
        notes = ["Means over the presses."]
        if not arguments.predictions:
            tables.append(drawn_in(photographs, first_methods))
            notes.append(
                "Depth, mm, by the distance from the ball's middle in contact radii; mean of the balls that were fitted to, seed 0."
            )
        if not any(press.absolute for press in photographs.presses):
            tables.append(radii(photographs, results))
            notes.append(
                "Of the sphere nearest to the depth in 0.85 of the contact: of that which a method reads itself, where it reads one."
            )
        for table, note in zip(tables, notes, strict=True):
            pages.append(table.markdown(note))
            print(pages[-1], flush=True)
        if arguments.write and any(press.absolute for press in photographs.presses):
            picture = arguments.write.with_name(f"{arguments.write.stem}-{photographs.name}.png")
            draw_presses(photographs, results[-1][1], picture)
            pages.append(f"![Depth read by the last network, truth, difference; mm]({picture.name})\n")
    if arguments.write:
        sources = " and ".join(f"<{entry.source}>" for entry in sets)
        head = PAGE_HEAD.format(f"commit {commit()}, {machine()}", sources)
        arguments.write.write_text(head + "\n".join(pages) + PAGE_END)


if __name__ == "__main__":
    main()
