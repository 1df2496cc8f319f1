"""The commands that a report prints."""

from pipeline.reports.provenance import commands
from pipeline.store.directory import DataDirectory
from pipeline.store.record import ShardRecord
from stages.registry import resolve


def test_a_command_names_what_differs_from_the_preset_and_nothing_else(tmp_path):
    settings = resolve("simulate-grasps", "draft", ["grasps=2"]).results()
    said = {"location": "g", "stage": "simulate-grasps", "key": "0" * 64, "settings": settings, "speed_settings": {}, "preset": "draft"}
    said |= {"seed": 3, "manifest": "toy", "models": {}, "versions": {}, "processor": {}, "schema_version": 1, "rows": ()}
    record = ShardRecord.model_validate({**said, "constants_digest": "0" * 64, "metadata": {}})
    (line,) = commands(DataDirectory(tmp_path), {"grasps": record})
    told = f"--manifest toy --preset draft --seed 3 --data {tmp_path} --set simulate-grasps.grasps=2"
    assert line == f"vt-pipeline run simulate-grasps {told}"
