"""Workers that die, hang or cannot start, full disks and unreachable schedulers."""

from __future__ import annotations

import errno
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import dask
import pytest
from distributed import Security

from pipeline.engine import dask_executor, local_cluster
from pipeline.engine.dask_executor import Dask
from pipeline.engine.executor import Serial
from pipeline.engine.session import Work
from pipeline.engine.stage import Inputs
from pipeline.engine.unit import Unit
from pipeline.errors import StageError, StoreError
from pipeline.store import publish
from pipeline.store.rows import Row
from pipeline.store.validate import problems_below
from tests.engine.tiny_stages import CONSOLE, MakeNoise, NoiseSettings, TakeMean, digest, objects, plan_of, published, request, run


class DiesOpening(MakeNoise):
    """Kills its process while a session opens, unless `flag` exists; with `once`, the first process that dies creates it."""

    def __init__(self, flag: Path, once: bool) -> None:
        super().__init__()
        self.flag, self.once = flag, once

    @contextmanager
    def session(self, settings: NoiseSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        if not self.flag.exists():
            if self.once:
                self.flag.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        with super().session(settings, models) as process:
            yield process


class NotesItsEnd(MakeNoise):
    """Writes a file when its session closes; its name says whether the same thread opened the session."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder

    @contextmanager
    def session(self, settings: NoiseSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        opener = threading.get_ident()
        with super().session(settings, models) as process:
            yield process
        (self.folder / ("closed there" if threading.get_ident() == opener else "closed elsewhere")).touch()


def test_workers_close_sessions_in_the_thread_that_opened_them(tmp_path):
    run(request(tmp_path / "data", stage=NotesItsEnd(tmp_path), executor=Dask()))
    assert [path.name for path in tmp_path.glob("closed*")] == ["closed there"]


def test_a_run_whose_worker_died_while_idle_continues(tmp_path):
    plan = plan_of(request(tmp_path))
    work = Work(plan.stage, plan.settings, tmp_path, {}, plan.assets)
    units = plan.units
    with Dask() as executor:
        assert len([*executor.run(work, units[:1])]) == 1
        for process in executor._connect(1).run(os.getpid).values():
            os.kill(process, signal.SIGKILL)
        results = [*executor.run(work, units[1:])]
        assert [(result.failure, result.bug) for result in results] == [(None, None)] * 4


def test_no_more_workers_start_than_there_are_units(tmp_path):
    plan = plan_of(request(tmp_path))
    work = Work(plan.stage, plan.settings, tmp_path, {}, plan.assets)
    with Dask(3) as executor:
        list(executor.run(work, plan.units[:1]))
        assert len(executor._connect(1).nthreads()) == 1
        list(executor.run(work, plan.units[1:3]))
        client = executor._connect(2)
        client.wait_for_workers(2, timeout=60)
        assert len(client.nthreads()) == 2


def test_object_beyond_its_time_limit_fails_and_the_others_are_processed(tmp_path):
    run(request(tmp_path, items=objects(3, b="hang"), settings={"object_seconds": 1}, executor=Dask()))
    assert "it took longer than object_seconds = 1; simplify the mesh, or raise it" in published(tmp_path).failure("b").reason
    assert published(tmp_path).failure("c") is None


@pytest.mark.slow
def test_only_the_crashing_and_hanging_objects_of_a_bundle_fail(tmp_path):
    items = objects(16, h="crash", j="hang")
    run(request(tmp_path, items=items, settings={"object_seconds": 6}, executor=Dask()))  # longer than replacing a worker takes
    failed = {item.object_id: failure.reason for item in items if (failure := published(tmp_path).failure(item.object_id))}
    assert failed.keys() == {"h", "j"}
    assert "its process died each time" in failed["h"]
    assert "it took longer than object_seconds = 6" in failed["j"]


@pytest.mark.parametrize(("rate", "share", "size"), [(0.0, 100, 1), (0.1, 100, 1), (7, 100, 14), (1e6, 100, 50), (1e6, 1.5, 1)])
def test_bundle_size_is_about_two_seconds_of_work_and_at_most_a_fair_share(rate, share, size):
    assert dask_executor._bundle_size(rate, share) == size


def test_session_that_cannot_open_ends_the_run_and_fails_no_object(tmp_path):
    with pytest.raises(StageError, match="make-noise cannot start: OSError: no device; `vt-pipeline doctor`"):
        run(request(tmp_path, stage=MakeNoise(broken=True)))
    assert run(request(tmp_path)) == 5


@pytest.mark.slow
def test_worker_killed_while_opening_its_session_is_restarted(tmp_path):
    assert run(request(tmp_path, stage=DiesOpening(tmp_path / "flag", once=True), executor=Dask())) == 5


@pytest.mark.slow
def test_worker_that_always_dies_while_opening_its_session_gives_a_clear_error(tmp_path):
    with pytest.raises(StageError, match=r"make-noise cannot start: its process died each time while it opened .* fewer --workers"):
        run(request(tmp_path, stage=DiesOpening(tmp_path / "flag", once=False), executor=Dask()))


@pytest.mark.parametrize("executor", [Serial(), Dask()])
def test_full_disk_gives_an_error_with_the_path_and_the_next_run_completes(tmp_path, executor):
    _, hard_limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard_limit))  # workers inherit the limit
    try:
        with pytest.raises(StoreError, match=r"noise/0000-of-0001 cannot be written: File too large; make room there, then run again"):
            run(request(tmp_path / "data", settings={"samples": 1000}, executor=executor))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard_limit, hard_limit))
    assert run(request(tmp_path / "data", settings={"samples": 1000})) == 5
    assert not any(problems_below(tmp_path / "data").values())


def test_too_many_open_files_is_not_reported_as_a_full_disk(tmp_path, monkeypatch):
    def write(*_: object, **__: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(publish, "write_group", write)
    with pytest.raises(StoreError, match=r"cannot be written: Too many open files; fix that, then run again"):
        run(request(tmp_path))


def test_out_of_memory_fails_the_object_and_the_others_are_processed(tmp_path):
    run(request(tmp_path, items=objects(3, b="memory")))
    assert "memory ran out; with more memory, or the mesh made smaller" in published(tmp_path).failure("b").reason
    assert published(tmp_path).failure("c") is None


@pytest.mark.slow
def test_worker_without_a_nanny_is_replaced(tmp_path):
    plan = plan_of(request(tmp_path))
    work, units = Work(plan.stage, plan.settings, tmp_path, {}, plan.assets), plan.units
    with dask.config.set({"distributed.deploy.lost-worker-timeout": "1s"}), Dask() as executor:
        assert len([*executor.run(work, units[:1])]) == 1
        executor._connect(1).cluster.sync(executor._connect(1).cluster.workers[0].close)
        assert len([*executor.run(work, units[1:])]) == 4


class _Cluster:
    """A scheduler and a worker in separate processes, as on a cluster, with certificates as in the guide."""

    def __init__(self, folder: Path) -> None:
        security = Security.temporary()
        self.certificate, self.key = folder / "dask.crt", folder / "dask.key"
        self.certificate.write_text(security.tls_ca_file)
        self.key.write_text(security.tls_client_key)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.folder, self.running = folder, []

    @property
    def address(self) -> str:
        return f"tls://127.0.0.1:{self.port}"

    def start(self) -> None:
        tls = ["--tls-ca-file", str(self.certificate), "--tls-cert", str(self.certificate), "--tls-key", str(self.key), "--no-dashboard"]
        scheduler = ["scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--protocol", "tls", *tls]
        worker = ["worker", self.address, "--nthreads", "1", "--local-directory", str(self.folder), *tls]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.running = [subprocess.Popen([sys.executable, "-m", "dask", *command], **quiet) for command in (scheduler, worker)]

    def kill(self) -> None:
        for process in self.running:
            process.kill()  # ends the worker's process, too
            process.wait()


@pytest.mark.slow
def test_restarted_cluster_gives_the_same_digest(tmp_path, monkeypatch):
    run(request(tmp_path / "here"))
    plan = plan_of(request(tmp_path / "there"))
    cluster = _Cluster(tmp_path)
    for name, file in (("CA_FILE", cluster.certificate), ("CLIENT__CERT", cluster.certificate), ("CLIENT__KEY", cluster.key)):
        monkeypatch.setenv(f"DASK_DISTRIBUTED__COMM__TLS__{name}", str(file))
    dask.config.refresh()
    cluster.start()
    try:
        with Dask(scheduler=cluster.address) as executor:
            results = executor.run(Work(plan.stage, plan.settings, tmp_path / "there", {}, plan.assets), plan.units)
            done = {next(results).name, next(results).name}
            cluster.kill()
            cluster.start()
            done |= {result.name for result in results}
    finally:
        cluster.kill()
        monkeypatch.undo()
        dask.config.refresh()
    assert done == {"a", "b", "c", "d", "e"}
    assert run(request(tmp_path / "there")) == 0
    assert digest(tmp_path / "there") == digest(tmp_path / "here")


def test_reused_workers_read_replaced_inputs_and_keep_temporary_files_in_dask_scratch_space(tmp_path):
    with Dask() as executor:
        for samples in (50, 60):
            run(request(tmp_path, settings={"samples": samples}))
            assert plan_of(request(tmp_path, TakeMean(), executor=executor)).make(CONSOLE).objects == 5
        profiling = executor._connect(1).run(dask.config.get, "distributed.worker.profile.enabled")
        assert [*profiling.values()] == [False]  # profiling makes a worker grow by 0.1 MB per second
        (temporary,) = executor._connect(1).run(tempfile.mkdtemp).values()
        assert Path(temporary).parent.parent.name == "dask-scratch-space"  # Dask clears this folder


def test_workers_that_start_too_late_give_an_error_with_a_remedy(monkeypatch):
    def late(*_: object, **__: object) -> None:
        raise TimeoutError

    monkeypatch.setattr(local_cluster, "_cluster_of", late)
    with pytest.raises(StageError, match=r"2 worker processes did not start in time.*--executor serial"):
        Dask(2)._connect(2)


def test_unreachable_scheduler_is_named(monkeypatch):
    monkeypatch.setattr(dask_executor, "CONNECT_SECONDS", 1)
    with pytest.raises(StageError, match=r"there is no Dask scheduler with workers at tcp://127\.0\.0\.1:9: .*; start both first"):
        Dask(scheduler="tcp://127.0.0.1:9")._connect(1)


def test_scheduler_that_needs_certificates_gives_an_error_with_the_guide():
    with pytest.raises(
        StageError, match=r"tls://127\.0\.0\.1:9 asks for certificates, and Dask's configuration names none; see .*speed-and-accuracy"
    ):
        Dask(scheduler="tls://127.0.0.1:9")._connect(1)


@pytest.mark.parametrize(("address", "why"), [("nowhere", "missing port number"), ("smtp://x:1", "unknown address scheme 'smtp'")])
def test_invalid_address_of_a_scheduler_is_named_at_once(address, why):
    with pytest.raises(StageError, match=f"there is no Dask scheduler with workers at {address}: {why}"):
        Dask(scheduler=address)._connect(1)
