"""Train a small U-Net that predicts depth from tactile images, in your own loop. It takes about a minute on the toy dataset.

The stage `train-unet` adds checkpoints, early stopping and a record of the inputs and settings.
"""

import argparse

import torch
from torch.utils.data import DataLoader

from pipeline.dataset.grasp_dataset import GraspDataset
from pipeline.kernels.networks.unet import UNet, contact_mask, masked_depth_loss
from pipeline.kernels.tensors import network_input
from pipeline.kernels.touch.depth_maps import gel_surface

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("data", nargs="?", default="data/toy/draft", help="default: %(default)s")
parser.add_argument("split", nargs="?", default="train", help="train, valid or test; default: %(default)s")
parser.add_argument("epochs", nargs="?", default=2, type=int, help="default: %(default)s")
given = parser.parse_args()

grasps = GraspDataset(given.data, ["tactile_image", "depth", "touch_success", "untouched"], given.split)
sensor = grasps.rows.sensor()
gel = torch.tensor(gel_surface(sensor))  # thickness of the gel or, if it is curved, its height at each pixel
torch.manual_seed(0)
network = UNet(width=4)
optimiser = torch.optim.Adam(network.parameters(), lr=3e-3)

for epoch in range(given.epochs):
    losses = []
    for batch in DataLoader(grasps, batch_size=1, shuffle=True):
        touched = batch["touch_success"]  # (B, sensor) bool
        tactile_images, depth = batch["tactile_image"][touched], batch["depth"][touched]  # (N, H, W, 3) uint8, (N, H, W) m
        if not len(tactile_images):
            continue
        mask = contact_mask(tactile_images, batch["untouched"][0, 0])  # pixels that the object changed
        predicted = network(network_input(tactile_images, torch.float32)) * sensor.w
        loss = masked_depth_loss(predicted, depth, mask, width=sensor.width, gel=gel)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(loss.item())
    rms = sensor.width * (sum(losses) / len(losses)) ** 0.5
    print(f"epoch {epoch}: {1e6 * rms:.0f} um RMS depth error")
