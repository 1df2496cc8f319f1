"""Inputs of `predict`: models, and an observation file with its images."""

import io
import json
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from checks.fuzz.target import Files, Target, files_made_by, seal
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.network_configurations import NetworkConfig
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.tactile_image import untouched_image
from pipeline.models.model_files import save_model
from pipeline.models.reconstruction import DeformationReconstructor, Trained
from pipeline.models.touch_model import load_touch_model, save_touch_model
from pipeline.reconstruct.observation_checks import check
from pipeline.reconstruct.predict import PredictOptions, predict
from pipeline.store.digest import hashes_of
from pipeline.store.directory import DataDirectory, record_of
from pipeline.store.publish import commit_folder
from pipeline.store.record import FolderRecord

NAME, PIXELS = "occluded-touch", 16
POSE = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]
WHOLE = 8
"""One in this many inputs goes through the networks; of the others, only the changed files are read."""


class Predictions(Target):
    """A small network of each kind with random weights, and inputs that fit them, in every format."""

    def sound(self) -> list[Files]:
        models = files_made_by(_models)
        facing = {"position": [0, 0, 0.5], "quaternion": [0, 0, 0, 1]}
        file = io.BytesIO()
        np.save(file, np.full((PIXELS, PIXELS), 0.5, np.float32))
        levels = _saved(np.full((PIXELS, PIXELS), 5000, np.uint16), "PNG")
        asked: list[Files] = [
            {"image": _image("PNG"), "tactile_image": _image("JPEG"), "depth": levels},
            {"image": _image("BMP"), "tactile_image": _image("TIFF"), "depth.npy": file.getvalue()},
            {"image": _image("TIFF"), "tactile_image": _image("PNG")},
        ]
        for files, pose in zip(asked, (facing, {"position": [0, 0, 0.5], "rpy": [0, 0, 0]}, POSE), strict=True):
            intrinsics = {"fx": 16, "fy": 16, "cx": 8, "cy": 8}
            camera = {"image": "image", "mask": "mask", "hand_mask": "image", "intrinsics": intrinsics, "pose": np.eye(4).tolist()}
            camera |= {"depth": next(iter(files.keys() - {"image", "tactile_image"}), None), "depth_scale": 1e-4, "convention": "opencv"}
            touch = {"name": "index", "tactile_image": "tactile_image", "pose": pose, "touched": True}
            observed = {"sensor": "gel_16mm", "untouched": "tactile_image", "touches": [touch], "camera": camera, "up": [0, -1, 0]}
            observed |= {"object": {"centre": [0, 0, 0.6], "diagonal": 0.4}, "unit": "m", "accept_photographs": True}
            files["grasp.yaml"] = json.dumps(observed).encode()
            files["mask"] = _saved(np.full((PIXELS, PIXELS), 255, np.uint8), "PNG")
        return [models | one for one in asked]

    def read(self, folder: Path, files: Files) -> None:
        content = zlib.crc32(b"".join(files.values()))
        if content % 8:
            for record in (folder / "unet.json", folder / f"gcn/{NAME}.json"):
                seal(
                    record,
                    lambda said, at=record.parent: {"files": hashes_of(at / said["location"])} if record_of(said["location"]) else {},
                )
        path = folder / "grasp.yaml"
        if content // 8 % WHOLE == 0:
            predict(folder / "made.ply", path, PredictOptions(folder, NAME))
            return
        readers: dict[str, Callable[[], object]] = {
            "gcn": lambda: DeformationReconstructor(DataDirectory(folder / "gcn").verified_folder(NAME)),
            "unet": lambda: load_touch_model(DataDirectory(folder).verified_folder("unet"), "cpu"),
            **dict.fromkeys(("grasp.yaml", "image", "tactile_image", "depth", "mask"), lambda: check(path)),
        }
        sound = {content for seed in self.seeds for content in seed.values()}
        changed = [name for name in files if files[name] not in sound]
        for reader in {reader for kind, reader in readers.items() if any(name.startswith(kind) for name in changed)}:
            reader()


def _image(kind: str) -> bytes:
    return _saved(np.random.default_rng(0).integers(0, 256, (PIXELS, PIXELS, 3), np.uint8), kind)


def _saved(pixels: np.ndarray, kind: str) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, kind)
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
        "network": config,
        "camera": [[16, 0, 0, 0], [0, 16, 0, 0], [0, 0, 1, 0]],
        "resolution": [PIXELS, PIXELS],
        "charts": {"side": 3, "max_iterations": 5, "samples": 50},
    }
    save_model(gcn, DeformationNetwork(config), Trained(**described))
    _publish(models, f"gcn/{NAME}", gcn)


def _publish(models: Path, name: str, folder: Path) -> None:
    record = FolderRecord(
        **{"location": "unpublished", "stage": "train", "key": "0" * 64, "settings": {}, "speed_settings": {}, "preset": "draft"},
        **{"seed": 0, "manifest": "m", "models": {}, "versions": {}, "processor": {}, "splits": (), "inputs": {}, "facts": {}},
        seconds=1.0,
        files=hashes_of(folder),
    )
    commit_folder(DataDirectory(models), name, folder, record)
