"""Samples represent all objects within a time limit."""

from collections import Counter
from pathlib import Path

import pytest

from pipeline.config.sources import Object
from pipeline.tradeoff.measure import FEWEST, MOST, Setup, stratified

OBJECTS = [Object(f"{kind}-{split}-{number:02d}", kind, {}, split) for kind in "abc" for split in ("train", "test") for number in range(20)]


@pytest.mark.parametrize("count", [6, 12, 30])
def test_every_split_and_category_has_its_share(count: int) -> None:
    found = Counter((item.split, item.category) for item in stratified(OBJECTS, count, seed=0))
    assert sum(found.values()) == count
    assert set(found.values()) == {count // 6}


def test_sample_follows_from_the_seed() -> None:
    assert stratified(OBJECTS, 12, seed=1) == stratified(OBJECTS, 12, seed=1)
    assert stratified(OBJECTS, 12, seed=1) != stratified(OBJECTS, 12, seed=2)


def test_sample_contains_files_of_all_sizes(tmp_path: Path) -> None:
    objects = []
    for size in range(40):
        (path := tmp_path / f"{size}.obj").write_bytes(b"#" * size)
        objects.append(Object(f"object-{39 - size:02d}", "", {"file": path}, "train"))
    sizes = sorted(item.source["file"].stat().st_size for item in stratified(objects, 4, seed=0))
    assert [size // 10 for size in sizes] == [0, 1, 2, 3]


def test_sample_of_a_small_manifest_is_complete_and_contains_rare_splits() -> None:
    assert stratified(OBJECTS[:3], 4, seed=0) == OBJECTS[:3]
    lonely = [*OBJECTS[:20], Object("alone", "a", {}, "valid")]
    assert "alone" in {item.object_id for item in stratified(lonely, 4, seed=0)}


@pytest.mark.parametrize(("seconds", "count"), [(0, FEWEST), (10, 10), (1000, MOST)])
def test_sample_stays_within_the_time_limit(seconds: float, count: int) -> None:
    objects = [Object(f"{number:02d}", "", {}, "train") for number in range(60)]
    setup = Setup(Path(), "many", objects, 0, "draft")
    assert len(setup.affordable(seconds, lambda sample: float(len(sample.objects))).objects) == count
