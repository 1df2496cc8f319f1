"""What `predict` reads: models, images, tactile images, poses."""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from pipeline.formats.image_file import read_image
from pipeline.formats.sensor_file import load_sensor
from pipeline.inference.grasp_input_files import read_poses, read_tactile_images
from pipeline.inference.predict import predict
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.network_configurations import NetworkConfig
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.tactile_image import untouched_image
from pipeline.models.deformation_reconstruction import DeformationReconstructor
from pipeline.models.model_files import save_model
from pipeline.models.touch_model import load_touch_model, save_touch_model
from pipeline.store.digest import hashes_of
from pipeline.store.directory import DataDirectory, is_version
from pipeline.store.publish import FolderOutput
from pipeline.store.record import FolderRecord
from tests.fuzz.target import Files, Target, files_made_by, seal

NAME, PIXELS = "occluded-touch", 16
WHOLE = 8
"""One in how many inputs goes through the networks; of the others, what was changed is read."""


class Predictions(Target):
    """A small network of each kind with random weights, and inputs that fit them, in every format."""

    def sound(self) -> list[Files]:
        models = files_made_by(_models)
        poses = np.eye(4)[None]
        file = io.BytesIO()
        np.savez_compressed(file, poses=poses, touched=np.array([True]))
        flags = {"poses": poses.tolist(), "touched": [True]}
        asked: list[Files] = [
            {"image": _image("PNG"), "tactile_image": _image("JPEG"), "poses.json": json.dumps(poses.tolist()).encode()},
            {"image": _image("BMP"), "tactile_image": _image("TIFF"), "poses.npz": file.getvalue()},
            {"image": _image("TIFF"), "tactile_image": _image("PNG"), "poses.json": json.dumps(flags).encode()},
        ]
        return [models | one for one in asked]

    def read(self, folder: Path, files: Files) -> None:
        content = zlib.crc32(b"".join(files.values()))
        if content % 8:
            for record in (folder / "unet.json", folder / f"gcn/{NAME}.json"):
                seal(
                    record,
                    lambda said, at=record.parent: {"files": hashes_of(at / said["location"])} if is_version(said["location"]) else {},
                )
        poses = folder / next(name for name in files if name.startswith("poses."))
        if content // 8 % WHOLE == 0:
            predict(folder / "made.ply", folder, NAME, image=folder / "image", tactile_images=[folder / "tactile_image"], poses=poses)
            return
        readers: dict[str, Callable[[], object]] = {
            "gcn": lambda: DeformationReconstructor(DataDirectory(folder / "gcn").whole_folder(NAME)),
            "unet": lambda: load_touch_model(DataDirectory(folder).whole_folder("unet"), "cpu"),
            "image": lambda: read_image(folder / "image"),
            "tactile_image": lambda: read_tactile_images([folder / "tactile_image"]),
            "poses": lambda: read_poses(poses),
        }
        sound = {content for seed in self.seeds for content in seed.values()}
        changed = [name for name in files if files[name] not in sound]
        for kind, reader in readers.items():
            if any(name.startswith(kind) for name in changed):
                reader()


def _image(kind: str) -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (PIXELS, PIXELS, 3), np.uint8)).save(file, kind)
    return file.getvalue()


def _models(models: Path) -> None:
    torch.set_num_threads(1)
    (unet := models / ".work" / "unet").mkdir(parents=True)
    sensor = load_sensor("gel_16mm").model_copy(update={"rows": PIXELS, "cols": PIXELS})
    save_touch_model(unet, UNet(1), sensor=sensor, untouched=untouched_image(sensor), mask_threshold=1e-3)
    _publish(models, "unet", unet)
    config = NetworkConfig(
        image="occluded", touch=True, encoder_layers=25, encoder_width=1 / 256, gcn_layers=2, gcn_features=3, splits=0, side=3
    )
    (gcn := models / ".work" / "gcn").mkdir()
    described: dict[str, Any] = {
        "configuration": NAME,
        "network": config.model_dump(mode="json", exclude={"checkpointing"}),
        "camera": [[16, 0, 0, 0], [0, 16, 0, 0], [0, 0, 1, 0]],
        "resolution": [PIXELS, PIXELS],
        "charts": {"side": 3, "max_iterations": 5, "samples": 50},
    }
    save_model(gcn, DeformationNetwork(config), described)
    _publish(models, f"gcn/{NAME}", gcn)


def _publish(models: Path, name: str, folder: Path) -> None:
    record = FolderRecord(
        **{"location": "unpublished", "stage": "train", "key": "0" * 64, "settings": {}, "speed_settings": {}, "preset": "draft"},
        **{"seed": 0, "manifest": "m", "models": {}, "versions": {}, "processor": {}, "splits": (), "inputs": {}, "facts": {}},
        seconds=1.0,
        files=hashes_of(folder),
    )
    FolderOutput(DataDirectory(models), name).commit(folder, record)
