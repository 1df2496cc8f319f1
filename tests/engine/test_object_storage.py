"""Data in object storage have the same arrays, digests and guarantees as on a disk."""

import itertools
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from uuid import uuid4

import pytest

from pipeline.engine.worker_processes import WorkerProcesses
from pipeline.errors import InvalidInput, StageError, StoreError
from pipeline.store import garbage, publish, storage
from pipeline.store.atomic import create, replace_version, version_of, write_atomically
from pipeline.store.directory import DataDirectory
from pipeline.store.publish import write_group
from pipeline.store.rows import Result, RowFiles
from pipeline.store.shard import RowView
from pipeline.store.storage import Location, as_location, files_below, read_bytes, remove
from pipeline.store.temporary import local_copy
from pipeline.store.validate import problems_below
from pipeline.tables.status import read_account
from tests.engine.tiny_stages import CONSOLE, MEAN, Average, MakeNoise, TakeMean, digest, objects, plan_of, published, request, run
from tests.object_storage import BUCKET, Answer, Proxy, clear, make_bucket, moto_server, proxy, use

BRIEF = {"init_backoff": timedelta(milliseconds=10), "max_backoff": timedelta(milliseconds=50)}


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    with moto_server() as address:
        make_bucket(address)
        yield address


@pytest.fixture
def data(server, monkeypatch, tmp_path) -> Location:
    """Return a fresh prefix in the bucket."""
    use(monkeypatch, server, tmp_path / "cache")
    return as_location(f"s3://{BUCKET}/{uuid4().hex}")


@pytest.fixture
def faults(data, server, monkeypatch, tmp_path) -> Iterator[Proxy]:
    """Put a proxy in front of `data`."""
    with proxy(server) as running_proxy:
        use(monkeypatch, running_proxy.address, tmp_path / "cache")
        monkeypatch.setattr(storage, "RETRY", storage.RETRY | {"backoff": BRIEF})
        yield running_proxy


def run_all_stages(data: Location, **changes) -> None:
    for stage in (MakeNoise(), TakeMean(), Average()):
        run(request(data, stage, **changes))


def digests(data: Location) -> tuple[object, ...]:
    return digest(data), digest(data, MEAN), DataDirectory(data).folder("models/average").files


def test_digests_equal_those_on_a_disk(data, tmp_path):
    run_all_stages(tmp_path / "disk")
    run(request(data, executor=WorkerProcesses(2), shards=3))
    run_all_stages(data)
    assert digests(data) == digests(tmp_path / "disk")
    assert not any(problems_below(data).values())
    before = files_below(data)
    run_all_stages(data)
    assert files_below(data) == before, "a second run writes nothing"
    assert not [name for name in before if name.startswith(".work")]


def test_damaged_or_missing_chunk_is_detected_and_made_again(data):
    run(request(data))
    before, (group,) = digest(data), [shard.path for shard in published(data).shards]
    content = read_bytes(group / "values/c/0/0/0")
    write_atomically(group / "values/c/0/0/0", content[:100] + bytes([content[100] ^ 1]) + content[101:])
    assert [lines for lines in problems_below(data).values() if lines]
    run(request(data, check=True))
    assert not any(problems_below(data).values())
    assert digest(data) == before
    remove(group / "values/c/0/0/0")
    assert run(request(data)), "a file that is missing is missed"


def test_unfinished_run_is_continued_on_another_machine(data, tmp_path):
    run(request(data, items=objects(3, b="bad")))
    assert read_account(data).artifacts[0].failures == {"b": {"stage": "make-noise", "reason": "it is bad; make it good"}}
    with pytest.raises(InvalidInput, match="it is bad"):
        run(request(data, items=objects(4, c="bad"), strict=True))
    clear(tmp_path / "cache")
    assert run(request(data, items=objects(4, c="bad"))) == 1, "what was finished before is kept, in object storage"


def test_unfinished_folder_is_continued_on_another_machine(data, tmp_path):
    run(request(data))
    with pytest.raises(StageError, match="no more"):
        plan_of(request(data, Average(dies=True))).make(CONSOLE)
    clear(tmp_path / "cache")
    plan_of(request(data, Average())).make(CONSOLE)
    assert DataDirectory(data).folder("models/average").facts == {"resumed": True}
    assert not [name for name in files_below(data) if name.startswith(".work")]


def test_files_not_sent_by_a_killed_run_are_sent_by_the_next(data):
    folder = data / "work"
    (unsent := storage.cache_of(folder) / "row").parent.mkdir(parents=True)
    unsent.write_text("made, not sent")
    with pytest.raises(KeyboardInterrupt), local_copy(folder, send=True):
        raise KeyboardInterrupt
    assert read_bytes(folder / "row") == b"made, not sent"


def test_local_copy_of_a_model_is_checked_against_its_record(data, tmp_path):
    run_all_stages(data)
    DataDirectory(data).verified_folder("models/average")
    for copy in (tmp_path / "cache").rglob("mean.json"):
        copy.write_text("{}")
    assert DataDirectory(data).verified_folder("models/average").joinpath("mean.json").read_text() != "{}"
    write_atomically(DataDirectory(data).folder_path("models/average") / "mean.json", b"{}")
    clear(tmp_path / "cache")
    with pytest.raises(StoreError, match=r"mean\.json differs from what was written; delete s3://"):
        DataDirectory(data).verified_folder("models/average")


def test_later_of_two_concurrent_runs_is_refused_and_publishes_nothing(data, monkeypatch, tmp_path):
    late, early = (request(data, items=objects(3), settings={"samples": samples}) for samples in (40, 50))

    def write_late(*arguments, **options):
        monkeypatch.setattr(publish, "write_group", write_group)
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "another machine"))
        run(early)
        return write_group(*arguments, **options)

    monkeypatch.setattr(publish, "write_group", write_late)
    with pytest.raises(StoreError, match="was published by another run meanwhile; run again"):
        run(late)
    assert published(data).first.read("values").shape == (3, 50, 3)
    assert plan_of(early).up_to_date(), "the note that it is replaced does no harm"
    run(late)
    assert published(data).first.read("values").shape == (3, 40, 3)


def test_concurrent_runs_of_the_same_rows_both_succeed(data, monkeypatch, tmp_path):
    def write_late(*arguments, **options):
        monkeypatch.setattr(publish, "write_group", write_group)
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "another machine"))
        assert not run(request(data)), "rows that are finished are shared"
        return write_group(*arguments, **options)

    monkeypatch.setattr(publish, "write_group", write_late)
    run(request(data))
    assert not any(problems_below(data).values())


def test_conditional_put_succeeds_once_and_is_recognised_after_a_lost_answer(data, faults):
    record = data / "record.json"
    create(record, b"first")
    create(record, b"second")
    assert read_bytes(record) == b"first"
    version = version_of(record)
    assert replace_version(record, b"third", version)
    assert not replace_version(record, b"fourth", version)
    lost = iter([Answer(500, late=True)])
    faults.fault = lambda method, path: next(lost, None) if method == "PUT" else None
    assert replace_version(record, b"fifth", version_of(record)), "done, and refused when it was repeated"
    assert read_bytes(record) == b"fifth"


@pytest.mark.parametrize("late", [pytest.param(False, marks=pytest.mark.slow), True])
def test_requests_with_broken_connections_are_retried(data, faults, late):
    broken = iter([Answer(None, late)] * 6)
    faults.fault = lambda method, path: next(broken, None) if method in ("PUT", "POST", "DELETE") else None
    assert replace_version(data / "record.json", b"mine", None)
    broken = iter([Answer(None, late)] * 6)
    remove(data)
    assert not next(broken, None)
    assert not files_below(data)


@pytest.mark.parametrize("status", [409, 412])
def test_conflict_without_a_winner_is_retried(data, faults, status):
    refusals = iter([Answer(status)] * 3)
    faults.fault = lambda method, path: next(refusals, None) if method == "PUT" else None
    assert replace_version(data / "record.json", b"mine", None)
    assert read_bytes(data / "record.json") == b"mine"


@pytest.mark.parametrize("status", [500, 503, None])
def test_intermittent_server_errors_do_not_change_the_digest(data, faults, tmp_path, status):
    answers = itertools.cycle([Answer(status, late=True), None, None, Answer(status), None, None, None])
    faults.fault = lambda method, path: next(answers)
    for place_of_data in (data, tmp_path / "disk"):
        run(request(place_of_data))
    assert digest(data) == digest(tmp_path / "disk")


def test_open_reader_of_a_collected_group_gets_a_clear_error(data):
    run(request(data))
    names = ("values", "reach", "lists/numbers")
    shard = published(data).shard("b")
    assert all(RowView(shard, "b")[name].any() for name in names)
    view = RowView(shard, "b")  # has read nothing yet
    run(request(data, seed=1))
    garbage.collect_everything(DataDirectory(data), older_than=-1)
    for name in names:
        with pytest.raises(StoreError, match="it was replaced since it was opened: open the dataset again"):
            view[name]
    assert published(data).view("b")["values"].any()


@pytest.mark.slow
def test_unreachable_server_gives_an_error_with_a_remedy(data, faults, monkeypatch):
    run(request(data))
    monkeypatch.setattr(storage, "RETRY", storage.RETRY | {"max_retries": 1})
    storage.client_of.cache_clear()
    plan = plan_of(request(data, settings={"samples": 9}))
    faults.fault = lambda method, path: Answer(503)
    with pytest.raises(StoreError, match=r"s3://.*/noise/0000-of-0001 cannot be written: .*503.*; check that it is reachable"):
        plan.make(CONSOLE)
    faults.fault = lambda method, path: None
    run(request(data, settings={"samples": 9}))
    assert not any(problems_below(data).values())


def test_garbage_is_old_and_named_by_no_record(data, monkeypatch):
    run(request(data))
    run(request(data, settings={"samples": 9}))
    (replaced,) = garbage.all_unreferenced(DataDirectory(data))
    assert garbage.collect_everything(DataDirectory(data)) == [], "it was replaced just now"
    later = time.time() + 2 * garbage.GRACE_SECONDS
    monkeypatch.setattr(garbage.time, "time", lambda: later)
    assert garbage.collect_everything(DataDirectory(data)) == [replaced]
    assert not files_below(replaced)
    RowFiles(DataDirectory(data).work("noise")).save(Result(name="a", key="0"), {})
    assert garbage.collect_everything(DataDirectory(data)) == [], "a run may still make the other rows"
    week_later = later + 2 * garbage.UNFINISHED_SECONDS
    monkeypatch.setattr(garbage.time, "time", lambda: week_later)
    assert len(garbage.collect_everything(DataDirectory(data))) == 1, "a row that no run has packed"
    assert not any(problems_below(data).values())


def test_unsupported_scheme_is_refused():
    with pytest.raises(InvalidInput, match=r"ftp://x/y cannot hold data; give a folder, or s3://BUCKET/PREFIX"):
        as_location("ftp://x/y")
    assert as_location("data/toy") == Path("data/toy")
