"""Keys change with the code and data that decide results, and with nothing else."""

import ast
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.engine import keys
from pipeline.engine.keys import NO_RESULTS, source_key, sources_hash, syntax
from stages.registry import STAGES, load_stage

ROOT = Path(__file__).parents[2]
SCRIPT = """
import json, sys
from pathlib import Path
from pipeline.engine import keys

def hashes():
    for cached in (keys.sources_hash, keys._file_of):
        cached.cache_clear()
    return {name: keys.sources_hash(name) for name in modules}

changes, modules = json.loads(sys.argv[1])
before = hashes()
for file in changes:
    Path(file).write_text(Path(file).read_text() + "\\n# a comment decides nothing\\n")
assert hashes() == before
rehashed = {}
for file in changes:
    Path(file).write_text(Path(file).read_text() + "\\nCHANGED = True\\n")
    now = hashes()
    rehashed[file] = sorted(name for name in modules if now[name] != before[name])
    before = now
print(json.dumps(rehashed))
"""
STAGE_MODULES = sorted({type(load_stage(name)).__module__ for name in STAGES})
MODULES = ("pipeline.contrib.toy_objects.knife", "pipeline.contrib.toy_objects.bottle", *STAGE_MODULES)


def test_missing_module_is_an_error_and_not_an_empty_hash():
    with pytest.raises(ModuleNotFoundError, match=r"no module pipeline\.tables\.gone"):
        sources_hash("pipeline.tables.gone")


def test_layers_left_out_of_the_hash_exist():
    for layer in NO_RESULTS:
        path = ROOT / layer.replace(".", "/")
        assert path.is_dir() or path.with_suffix(".py").is_file(), layer


def test_procedural_object_is_keyed_by_the_code_of_its_maker():
    knife, bottle = (source_key({"kind": "procedural", "category": name, "variant": 0, "seed": 0})["code"] for name in ("knife", "bottle"))
    assert knife != bottle


def test_changed_module_rehashes_the_stages_that_depend_on_it_only(tmp_path):
    expected = {
        "pipeline/contrib/toy_objects/knife.py": ["pipeline.contrib.toy_objects.knife"],
        "pipeline/rng.py": sorted(MODULES),
        "pipeline/store/shard.py": [],
        "pipeline/engine/make.py": [],
        "pipeline/kernels/geometry/exterior_sampling.py": ["stages.evaluate.stage", "stages.sample_surfaces"],
        "pipeline/kernels/vision/primitives.py": ["stages.render_vision.stage"],
        "pipeline/kernels/touch/tactile_image.py": ["stages.simulate_presses", "stages.simulate_slides", "stages.simulate_touch"],
        "pipeline/kernels/networks/unet.py": ["stages.fit_charts", "stages.train_touch", "stages.train_unet"],
        "pipeline/kernels/charts/chart_steps.py": ["stages.fit_charts"],
        "pipeline/kernels/metrics/retrieval.py": ["stages.evaluate.stage"],
    }
    for package in ("pipeline", "stages", "schemas"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__", "*.obj"))
    command = [sys.executable, "-c", SCRIPT, json.dumps([list(expected), MODULES])]
    completed = subprocess.run(command, cwd=tmp_path, env={"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True, check=True)
    assert json.loads(completed.stdout) == expected


def test_source_files_are_decoded_by_their_declared_encoding(tmp_path: Path) -> None:
    hashes = set()
    for encoding in ("utf-8", "latin-1"):
        (path := tmp_path / f"{encoding}.py").write_bytes(f"# -*- coding: {encoding} -*-\nMICRO = 'µ'\n".encode(encoding))
        hashes.add(keys._parse("package", path)[0])
    assert len(hashes) == 1


def test_syntax_hash_is_equal_for_every_version_of_python() -> None:
    code = "def f(x, *, y=None) -> str:\n    'Say.'\n    return [f'{x!r:>3}', (), None]\n"
    assert syntax(ast.parse(code)) == (
        "(Module body=[(FunctionDef name='f' args=(arguments args=[(arg arg='x')] kwonlyargs=[(arg arg='y')] kw_defaults=[(Constant)]) "
        "body=[(Expr value=(Constant value='Say.')) (Return value=(List elts=[(JoinedStr values=[(FormattedValue value=(Name id='x' "
        "ctx=(Load)) conversion=114 format_spec=(JoinedStr values=[(Constant value='>3')]))]) (Tuple ctx=(Load)) (Constant)] "
        "ctx=(Load)))] returns=(Name id='str' ctx=(Load)))])"
    )
