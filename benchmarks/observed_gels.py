"""Compare reconstructions from exact touches and from touches read in simulated photographs: `python -m benchmarks.observed_gels DATA`.

The first grasp of each object of a split is written as a robot's observation: a photograph with the hand in it, masks, camera, the object's
box, and touches as `read-touch` reads them in the sensors' photographs; beside it with exact touches, and without any.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from benchmarks.provenance import commit, machine
from benchmarks.robot_grasp import BASE, write_grasp
from benchmarks.timing import Table
from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.metrics.bootstrap import difference_interval, mean_interval
from pipeline.kernels.metrics.cloud_distances import cloud_distances
from pipeline.kernels.touch.depth_maps import gel_surface, press_gel, pressed_pixels
from pipeline.kernels.vision.scene import Label
from pipeline.models.shipped_weights import SHIPPED
from pipeline.real_touch import TouchReader, write_reading
from pipeline.reconstruct.observation_checks import check
from pipeline.reconstruct.observation_placement import place_observation
from pipeline.reconstruct.observation_reader import ObservationReader
from pipeline.reconstruct.predict import PredictOptions
from pipeline.rng import numpy_rng
from pipeline.store.storage import as_location
from pipeline.tables.part_tables import DISTANCES
from stages.evaluate.measure import SPLIT, MeasuredObjects, sample_reconstruction
from stages.evaluate.protocols import NEAR
from stages.evaluate.surface_parts import SurfaceParts

ARRAYS = ("points", "depth", "untouched", "sensor_pose", "touch_success", "tactile_image", "projection", "segmentation")
SEEN, EXACT, READ = "no touches", "exact depth", "photographs of gels"
PAIRS = ((READ, EXACT), (READ, SEEN), (EXACT, SEEN))
METRICS = {**DISTANCES, "F-score at 5 mm": "f_5mm"}
POINTS = 10_000  # drawn from each surface
READINGS = (
    "contact is seen",
    "contact, IoU",
    "error of depth in the contact, mm",
    "rim is pressed",
    "contact is read more than three times too large",
)


def write_observations(objects: MeasuredObjects, object_id: str, folder: Path) -> tuple[dict[str, Path], list[list[float]]]:
    """Write the first grasp of an object as observation files, by what they give; compare its touches with those read, in `READINGS`."""
    entries = yaml.safe_load(write_grasp(objects.data, object_id, 0, folder).read_text())
    sensor = objects.sensor()
    depths, images, untouched = (objects.read(name, object_id)[0] for name in ("depth", "tactile_image", "untouched"))
    reader = TouchReader(sensor.name, untouched)
    given: dict[str, list[object]] = {SEEN: [], EXACT: [], READ: []}
    readings = []
    for touch, depth, image in zip(entries["touches"], depths, images, strict=True):
        reading, gel, name = reader.read(image), press_gel(depth, sensor), touch["name"]
        write_reading(reading, folder, name)
        np.save(folder / f"{name}-exact.npy", np.maximum(gel_surface(sensor) - depth, 0))
        Image.fromarray(pressed_pixels(depth, sensor)).save(folder / f"{name}-exact.png")
        placed = {"name": name, "pose": touch["pose"]}
        exact = {"depth": f"{name}-exact.npy", "contact": f"{name}-exact.png", "touched": touch["touched"]}
        given[EXACT].append(placed | exact)
        given[READ].append(placed | {"depth": f"{name}-depth.png", "contact": f"{name}-contact.png"})
        if gel.contact.any():
            iou = (reading.contact & gel.contact).sum() / (reading.contact | gel.contact).sum()
            error = 1e3 * np.abs(reading.indentation - gel.indentation)[gel.contact].mean()
            too_large = reading.contact.sum() > 3 * gel.contact.sum()
            readings.append([reading.contact.any(), iou, error, reading.rim_pressed, too_large])
    kept = {name: entries[name] for name in ("unit", "object", "camera")}
    paths = {kind: folder / f"{kind}.yaml" for kind in given}
    for kind, touches in given.items():
        paths[kind].write_text(yaml.safe_dump(kept | ({"sensor": entries["sensor"], "touches": touches} if touches else {})))
    return paths, readings


def errors(
    path: Path,
    reader: ObservationReader,
    truth: Array,  # (N, 3) points of the object, m
    parts: dict[str, Mask],  # (N,) whether these lie in a part of the surface
) -> list[float]:
    """Reconstruct an object from an observation file, and measure `METRICS`, mm and %; NaN of parts without points."""
    placed = place_observation(check(path, reader.target))
    restricted = reader.restricted_to(placed.checked.inputs)
    surface = restricted.model.reconstruct([restricted.of_robot(placed)])[0]
    drawn, _ = sample_reconstruction(surface, len(truth), numpy_rng(0, "drawn"))
    distances = cloud_distances(transform_points(np.linalg.inv(BASE), placed.returned(drawn)), truth)
    figures = {"mean_distance": 1e3 * distances.mean_distance, "f_5mm": 100 * distances.f1(NEAR**2)}
    figures |= {f"{part}_distance": 1e3 * float(np.sqrt(distances.truth[mask]).mean()) for part, mask in parts.items() if mask.any()}
    return [figures.get(metric, np.nan) for metric in METRICS.values()]


def tables(found: dict[str, Array], readings: list[list[float]]) -> list[Table]:  # (objects, metrics) each
    """Tabulate errors, paired differences, and how touches are read."""
    whole = Table("Distances, mm, and F-scores, %, by what is given beside a photograph: one grasp", [*METRICS, "median of the whole"])
    for kind, values in found.items():
        intervals = (mean_interval(column[np.isfinite(column)], numpy_rng(0, "intervals")) for column in values.T)
        cells = (f"{interval:.2f}".replace("\n", " ") for interval in intervals)
        whole.add(kind, *cells, f"{np.median(values[:, 0]):.2f}")
    paired = Table("Paired differences, % of the second", list(METRICS))
    for first, second in PAIRS:
        scaled = (100 * found[kind] / np.nanmean(found[second], axis=0) for kind in (first, second))
        pairs = (np.stack(pair)[:, np.isfinite(pair).all(axis=0)] for pair in zip(*(values.T for values in scaled), strict=True))
        paired.add(
            f"{first} − {second}", *(difference_interval(ours, theirs, numpy_rng(0, "intervals")).signed(".1f") for ours, theirs in pairs)
        )
    read = Table("Touches read in photographs", READINGS)
    read.add(f"mean of {len(readings)}", *(f"{value:.3f}" for value in np.mean(readings, axis=0)))
    return [whole, paired, read]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=as_location)
    parser.add_argument("--models", type=as_location, default=SHIPPED)
    parser.add_argument("--split", default=SPLIT)
    parser.add_argument("--every", type=int, default=1, help="measure every Nth object of the split")
    arguments = parser.parse_args()
    objects = MeasuredObjects(arguments.data, ARRAYS, POINTS, "observed_gels", split=arguments.split)
    reader = PredictOptions(models=arguments.models, configuration="implicit-gels", accelerator="cpu").reader()
    parts, found, readings = SurfaceParts(objects, image=True, touch=True), dict[str, list[list[float]]](), list[list[float]]()
    for object_id in objects.object_ids[:: arguments.every]:
        if not (parts.view(object_id, 0)[1] == Label.OBJECT).any():
            print(f"{object_id}: skipped, the hand hides all of it from the camera")
            continue
        with tempfile.TemporaryDirectory() as folder:
            paths, of_object = write_observations(objects, object_id, Path(folder))
            readings += of_object
            for kind, path in paths.items():
                found.setdefault(kind, []).append(errors(path, reader, objects.points(object_id), parts.masks(object_id, 0)))
        print(object_id, *(f"{kind} {rows[-1][0]:.2f} mm" for kind, rows in found.items()), sep=", ", flush=True)
    for table in tables({kind: np.array(rows) for kind, rows in found.items()}, readings):
        print(table.markdown(f"{len(found[SEEN])} objects, commit {commit()}, {machine()}."))


if __name__ == "__main__":
    main()
