"""The objects of a dataset that no stage failed on, with the hand, the sensors and the scene they were made with."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import ValidationError

from pipeline.console import abbreviate
from pipeline.dataset.grasps import grasping_hand
from pipeline.dataset.object_rows import UsableObjects
from pipeline.errors import InvalidInput, StoreError
from pipeline.formats.description_file import invalid_entries
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.vision.scene import Scene
from pipeline.store.storage import Location
from schemas.catalogue import ARTIFACTS


class CompletedObjects(UsableObjects):
    """All objects that failed in none of the artifacts that are read, in id order."""

    def __init__(
        self,
        data: Location,
        needed: Sequence[str],  # artifacts
        optional: Sequence[str] = (),  # artifacts that are read if they have been made
    ) -> None:
        super().__init__(data, [ARTIFACTS[name] for name in needed], None, [ARTIFACTS[name] for name in optional])

    def rows(self, object_id: str) -> dict[str, Mapping[str, np.ndarray]]:
        """Open an object's rows, by artifact; each array is read once."""
        return {name: collection.view(object_id) for name, collection in self.collections.items()}

    def digests(self, object_id: str) -> dict[str, str]:
        """Collect the digests of an object's rows, by artifact."""
        return {name: collection.row(object_id).digest for name, collection in self.collections.items()}

    def check_known(self, object_id: str) -> None:
        """Raise an `InvalidInput` if an object failed or does not exist."""
        if object_id not in self.object_ids:
            failure = self.failures.get(object_id)
            failed = f", where it failed in {failure.stage}: {failure.reason}" if failure else ""
            raise InvalidInput(f"{object_id} is not a usable object of {self.directory.root}{failed}; it has {abbreviate(self.object_ids)}")

    @property
    def name(self) -> str:
        """The manifest's name, and the preset's."""
        return f"{self.attributes('grasps')['manifest']} · {self.collections['grasps'].first.record.preset}"

    def hand(self) -> Hand:
        """Load the hand that grasped."""
        return grasping_hand({name: self.attributes(name) for name in self.collections})

    def scene(self) -> Scene:
        """Read the scene that the images show; load the supplement's for a dataset without images."""
        return dataset_scene(self.attributes("vision")) if "vision" in self.collections else load_scene("supplement")


def dataset_scene(attributes: Mapping[str, Any]) -> Scene:
    """Read the scene from the attributes of a `vision` group's root, whatever became of its file; a `StoreError` if it cannot be used."""
    try:
        return Scene.model_validate(attributes.get("scene"))
    except ValidationError as error:
        faults = invalid_entries(error)
        raise StoreError(f"the scene in `vision` cannot be used ({faults}); delete `vision` and run render-vision again") from error
