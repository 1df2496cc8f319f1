"""The import contract of pyproject.toml names every module."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_import_contract_names_every_module():
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]
    named = {module.strip() for layer in contract["layers"] for module in layer.split("|")}
    house, batteries = (_modules(package) for package in ("pipeline", "pipeline.contrib"))
    assert named == house - {"pipeline.contrib"} | batteries | {"stages", "schemas", "vt_pipeline"}


def _modules(package: str) -> set[str]:
    folder = ROOT / package.replace(".", "/")
    paths = [path for path in folder.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()]
    return {f"{package}.{path.stem}" for path in paths if path.stem != "__init__"}
