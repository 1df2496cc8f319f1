"""Read batches of grasps from a dataset as PyTorch tensors."""

import argparse

from torch.utils.data import DataLoader

from pipeline.dataset.grasp_dataset import GraspDataset

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("data", nargs="?", default="data/toy/draft", help="default: %(default)s")
parser.add_argument("split", nargs="?", default="train", help="train, valid or test; default: %(default)s")
given = parser.parse_args()

# docs/data-format.md lists the arrays. The dataset opens only the artifacts that hold the requested ones.
grasps = GraspDataset(given.data, ["tactile_image", "depth", "touch_success", "sensor_pose", "occluded", "points"], given.split)
print(f"{len(grasps)} grasps of {len(grasps.rows)} objects in split {given.split}; failed: {grasps.failed or 'none'}")

item = grasps[0]
print(f"{item['object_id']}, grasp {item['grasp']}:")
for name in grasps.arrays:
    print(f"  {name:14}{tuple(item[name].shape)} {item[name].dtype}")

# Items are dicts of tensors with equal shapes, so the default collate function stacks them. Memory does not grow with the dataset.
for batch in DataLoader(grasps, batch_size=4):
    touched = batch["touch_success"]  # (B, sensor) bool
    nearest = batch["depth"].amin(dim=(-2, -1))  # (B, sensor), m
    depths = ", ".join(f"{1e3 * float(depth):.1f}" for depth in nearest[touched])
    print(f"{', '.join(batch['object_id'])}: {int(touched.sum())} touches, nearest {depths} mm from the sensor plane")
