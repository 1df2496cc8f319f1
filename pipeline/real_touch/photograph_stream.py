"""Read photographs as they arrive: those of a folder, new ones that appear in it, or the frames of a camera."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.markup import escape

from pipeline.console import errors
from pipeline.errors import InvalidInput
from pipeline.formats.image_file import SUFFIXES, image_files, read_image

POLL_SECONDS = 0.05
"""Seconds between two scans of a watched folder."""
WRITTEN_SECONDS = 5
"""Time after the last change of a file from which it is no longer being written."""
NamedPhotograph = tuple[str, NDArray[np.uint8]]
"""A photograph, (rows, cols, 3) uint8, with its name."""


def photographs_of(path: Path, leave_out: Path) -> list[Path]:
    """List a photograph, or those of a folder in the order of their names, without the one to leave out.

    Raises
    ------
    InvalidInput
        There are none, or two would give output files of the same name.
    """
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise InvalidInput(f"{path} does not exist; give a photograph, or a folder of them")
    files = image_files(path.iterdir(), leave_out)
    if not files:
        raise InvalidInput(f"{path} holds no photographs besides the untouched one: files that end in {', '.join(SUFFIXES)}")
    for first, second in pairwise(sorted(files, key=lambda file: file.stem)):
        if first.stem == second.stem:
            raise InvalidInput(f"{first} and {second} have one name but for the suffix; rename one of them")
    return files


def watched(folder: Path, leave_out: Path) -> Iterator[NamedPhotograph]:
    """Yield the photographs of a folder, and then each new one, without end.

    A file that cannot be read may be half written: it is tried again, and reported once if it does not change any more.
    """
    if not folder.is_dir():
        raise InvalidInput(f"{folder} is no folder; --watch takes the one in which photographs appear")
    read_paths: set[Path] = set()
    reported: dict[Path, float] = {}
    while True:
        for path in image_files(folder.iterdir(), leave_out):
            if path in read_paths:
                continue
            try:
                if reported.get(path) == (changed := os.path.getmtime(path)):
                    continue
                image = read_image(path)
            except FileNotFoundError:  # moved away meanwhile
                continue
            except InvalidInput as error:
                if time.time() - changed > WRITTEN_SECONDS:
                    errors.print(f"[yellow]warning:[/] left out until it changes: {escape(str(error))}")
                    reported[path] = changed
                continue
            twin = next((other for other in read_paths if other.stem == path.stem), None)
            read_paths.add(path)
            if twin is None:
                yield path.stem, image
            else:
                errors.print(f"[yellow]warning:[/] left out: {escape(path.name)}, as {escape(twin.name)} has the same name; rename it")
        time.sleep(POLL_SECONDS)


def camera_frames(number: int) -> Iterator[NamedPhotograph]:
    """Yield the frames of a camera that OpenCV opens, named by their number, until it gives no more.

    Raises
    ------
    InvalidInput
        OpenCV is not installed, or there is no such camera.
    """
    try:
        import cv2
    except ImportError as error:
        raise InvalidInput("a camera needs OpenCV; `pip install -c constraints.txt -e '.[camera]'` installs it (50 MB)") from error
    capture: Any = cv2.VideoCapture(number)
    try:
        if not capture.isOpened():
            raise InvalidInput(f"OpenCV opens no camera {number}; is another program using it, or its number another one?")
        count = 0
        while True:
            received, frame = capture.read()
            if not received:
                return
            yield f"{count:06d}", np.ascontiguousarray(frame[:, :, ::-1])  # BGR
            count += 1
    finally:
        capture.release()
