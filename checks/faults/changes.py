"""Files and versions that change between one stage and the next."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

from checks.faults.sandbox import Sandbox, digests
from checks.faults.trial import Trial, Verdict
from checks.forked import IN_WORDS, OK, answer
from pipeline.formats.hand_file import load_hand
from pipeline.store.digest import of_json


def version_changed(trial: Trial) -> Verdict:
    """Write a record of another version of the project: with another schema version or record format."""
    trial.copy()
    records = sorted(path for path in trial.data.rglob("*.json") if "checksum" in path.read_text(errors="replace")[:20])
    path = records[trial.rng.integers(len(records))]
    content = json.loads(path.read_text())
    del content["checksum"]
    field = "schema_version" if "schema_version" in content and trial.rng.integers(2) else "format"
    content[field] += int(trial.rng.choice([-1, 1]))
    path.write_text(json.dumps({"checksum": of_json(content), **content}))
    first = trial.run(lambda: trial.sandbox.make(trial.data))
    return trial.mended(f"{path.relative_to(trial.data)}: {field} {content[field]}", first)


def description_changed(trial: Trial) -> Verdict:
    """Change a hand, sensor or mesh file after the grasps: later stages refuse it; a second run remakes everything with the new file."""
    shutil.rmtree(trial.folder, ignore_errors=True)
    trial.folder.mkdir(parents=True)
    hand = load_hand("allegro_right")
    shutil.copytree(hand.path.parent, trial.folder / "hands")
    shutil.copytree(hand.path.parents[1] / "sensors", trial.folder / "sensors")
    shutil.copytree(trial.sandbox.root, trial.folder / "source", ignore=shutil.ignore_patterns("lane-*", "whole"))
    own = trial.folder / "hands" / hand.path.name
    sensor = trial.folder / "sensors" / f"{hand.sensors[0].sensor}.yaml"
    sandbox = replace(
        trial.sandbox,
        root=trial.folder / "source",
        stages=("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch"),
        settings=(*trial.sandbox.settings, f"hand={own}", f"sensor={sensor}"),
    )
    sandbox.manifest.write_text(sandbox.manifest.read_text().replace(str(trial.sandbox.root), str(sandbox.root)))
    first = trial.run(lambda: sandbox.only("sample-surfaces", "simulate-grasps").make(trial.data))
    if first.status != OK:
        return Verdict("before the change", fault_of_ours=first.output.strip()[-600:])
    changed = str(trial.rng.choice(["hand", "urdf", "mesh of the hand", "sensor", "object"]))
    stage = "simulate-touch" if changed == "sensor" else "render-vision"
    _change(changed, own, sensor, sandbox)
    later = trial.run(lambda: sandbox.only(stage).make(trial.data))
    what = f"{changed} before {stage}"
    if changed != "object" and (later.status != IN_WORDS or "run simulate-grasps again" not in " ".join(later.output.split())):
        return Verdict(what, fault_of_ours=f"not refused: status {later.status}: {later.output.strip()[-600:]}")
    again = trial.run(lambda: sandbox.make(trial.data))
    fresh = trial.run(lambda: sandbox.make(trial.folder / "fresh"))
    if again.status or fresh.status:
        return Verdict(what, fault_of_ours=f"run again: {again.output.strip()[-300:]} {fresh.output.strip()[-300:]}")
    if answer(lambda: digests(trial.data), trial.log) != answer(lambda: digests(trial.folder / "fresh"), trial.log):
        return Verdict(what, fault_of_ours="run again: other digests than a dataset made of the new files alone")
    said = "no effect: the mesh is stored" if changed == "object" else "error in words"
    return Verdict(what, outcome=f"{said}; equal digests")


def _change(what: str, hand: Path, sensor: Path, sandbox: Sandbox) -> None:
    """Change a file so that it gives other data."""
    urdf = next(hand.parent.glob("*.urdf"))
    match what:
        case "hand":
            hand.write_text(hand.read_text() + "# another\n")
        case "urdf":
            urdf.write_text(urdf.read_text().replace('upper="', 'upper="0', 1))
        case "mesh of the hand":
            mesh = next(file for file in load_hand(hand).files if file.suffix.lower() in (".stl", ".obj"))
            mesh.write_bytes(mesh.read_bytes() + b"\n")
        case "sensor":
            sensor.write_text(sensor.read_text() + "# another\n")
        case "object":
            sandbox.mesh.write_text(sandbox.mesh.read_text().replace("v ", "v 0", 1))
