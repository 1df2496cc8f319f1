"""Draw the picture of lifts in `docs/guide/slides.md`: `python -m tools.lift_picture DATA`, a dataset with lifts."""

import io
import sys
from pathlib import Path

from PIL import Image, ImageSequence

from pipeline.dataset.completed_objects import CompletedObjects
from pipeline.drawing.sequence_pictures import animate, first_sequence

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "lift.webp"


def main() -> None:
    """Draw the last step of the first object's first lift."""
    source = CompletedObjects(Path(sys.argv[1]), ["touch"])
    drawn = first_sequence(source.collections["touch"].view(source.object_ids[0]), "lift")
    save_last(animate([drawn]), PICTURE)


def save_last(animation: bytes, path: Path) -> None:
    """Save the last frame of an animation."""
    with Image.open(io.BytesIO(animation)) as frames:
        *_, last = ImageSequence.Iterator(frames)
        last.convert("RGB").save(path, "WEBP", quality=80, method=6)


if __name__ == "__main__":
    main()
