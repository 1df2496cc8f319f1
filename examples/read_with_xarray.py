"""Read a dataset with xarray, as arrays with labels, units and descriptions."""

import argparse

from pipeline.dataset.labelled import open_artifact

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("data", nargs="?", default="data/toy/draft", help="default: %(default)s")
data = parser.parse_args().data

touch = open_artifact(data, "touch")  # all shards; xarray reads values on access
grasps = open_artifact(data, "grasps")
print(touch)

# Select by the names of objects and sensors. Dimensions have names too.
name, sensor = str(touch.object[0].item()), str(touch.sensor[0].item())
depth = touch.depth.sel(object=name, sensor=sensor)  # (grasp, row, col)
print(f"{depth.attrs['description']} In {depth.attrs['units']}.")
for grasp in depth.grasp.values:
    nearest = float(depth.sel(grasp=grasp).min(("row", "col")))
    succeeded = bool(grasps.touch_success.sel(object=name, sensor=sensor, grasp=grasp))
    print(f"{name}, {sensor}, grasp {grasp}: min D = {1e3 * nearest:.2f} mm, {'touch' if succeeded else 'no touch'}")

# Compute statistics over the dataset. Artifacts share their coordinates. Failed objects have rows of zeros; drop them.
rate = grasps.touch_success.where(grasps.ok).groupby("category").mean(("object", "grasp"))
print((100 * rate).round(1).to_pandas())
