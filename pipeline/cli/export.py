"""`vt-pipeline export`: write a dataset for other programs."""

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from pipeline.cli.failures import fail
from pipeline.cli.request import DataArgument
from pipeline.console import pluralise, print_line
from pipeline.formats.description_file import read_description
from pipeline.store.atomic import UNFINISHED, atomic_writes
from pipeline.store.storage import as_location, list_folder

Format = Literal["lerobot", "parquet", "webdataset", "mesh", "grasps", "dexgraspbench"]
MESHES = (".obj", ".ply", ".stl", ".off", ".dae", ".gltf", ".3mf")
"""Suffixes of mesh formats that are not written: a folder with such a name would be a mistake."""


def export(
    data: DataArgument,
    out: Annotated[Path, typer.Argument(help="Folder to write; of one object's scene, a .glb file.")],
    to: Annotated[
        Format, typer.Option(help="lerobot and parquet need the packages of '.\\[export]', dexgraspbench those of '.\\[mujoco]'.")
    ] = "mesh",
    objects: Annotated[list[str] | None, typer.Option("--object", help="With --to mesh: only this object; repeat for several.")] = None,
    about: Annotated[
        Path | None, typer.Option(help="With --to parquet: a YAML file with title, creators, url, licence … for card and Croissant.")
    ] = None,
) -> None:
    """Write a dataset for other programs.

    The formats are LeRobot v3, Hugging Face parquet, WebDataset shards and glTF scenes, all lossless; and grasps for robots: arrays in each
    object's own frame, or the files of DexGraspBench.
    """
    from pipeline.contrib.exports.croissant import write_croissant
    from pipeline.contrib.exports.dataset_card import About, facts_of, write_card
    from pipeline.contrib.exports.grasp_files import GraspedObjects, write_dexgraspbench, write_grasps
    from pipeline.contrib.exports.grasp_frames import GraspFrames
    from pipeline.contrib.exports.lerobot_files import write_lerobot
    from pipeline.contrib.exports.parquet_files import write_parquet
    from pipeline.contrib.exports.scene_files import write_scenes
    from pipeline.contrib.exports.webdataset_shards import write_webdataset
    from pipeline.dataset.completed_objects import CompletedObjects

    if out.suffix.lower() in MESHES:
        fail(f"{out}: scenes are written as glTF; name a folder, or of one object (--object) a .glb file")
    existing = list_folder(out)
    blocked = out.is_file() and (to != "mesh" or out.suffix.lower() != ".glb")
    if blocked or (existing and UNFINISHED not in existing):  # an export that was killed is begun again
        fail(f"{out} is {'a file' if blocked else 'not empty'}; name a folder that is not there yet")
    if to == "mesh":
        source = CompletedObjects(as_location(data), ("surfaces", "grasps", "touch"), ("charts",))
        print_line(f"{out}: {pluralise(write_scenes(source, out, list(dict.fromkeys(objects or []))), 'scene')}")
        return
    if objects:
        fail(f"--object is for --to mesh; --to {to} writes the whole dataset")
    if about and to != "parquet":
        fail(f"--about is for --to parquet; --to {to} writes no card")
    publisher = read_description("about", about, About) if about else About()
    grasp_writers = {"grasps": write_grasps, "dexgraspbench": write_dexgraspbench}
    table_writers = {"lerobot": write_lerobot, "parquet": write_parquet, "webdataset": write_webdataset}
    frames = None if to in grasp_writers else GraspFrames(as_location(data))
    write = partial(table_writers[to], frames) if frames else partial(grasp_writers[to], GraspedObjects(as_location(data)))
    with atomic_writes(out) as folder:
        count = write(folder)
        if to == "parquet" and frames:
            facts = facts_of(as_location(data), frames)
            write_card(as_location(data), facts, publisher, folder)
            write_croissant(facts, publisher, folder)
    print_line(f"{out}: {pluralise(count, 'grasp')}")
    missing = [name for name in ("url", "creators", "licence", "published") if not getattr(publisher, name)]
    if to == "parquet" and missing:
        print_line(f"README.md and croissant.json lack {', '.join(missing)}, which only you know: give --about FILE with these entries")
