"""The import contract of pyproject.toml names every module."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_import_contract_names_every_module():
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]
    named = {module.strip() for layer in contract["layers"] for module in layer.replace("|", ":").split(":")}
    modules = {f"pipeline.{path.stem}" for path in (ROOT / "pipeline").iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert named == (modules - {"pipeline.__init__"}) | {"stages", "schemas", "vt_pipeline"}
