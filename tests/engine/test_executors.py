"""Workers that die, hang or cannot start, full disks and unreachable schedulers."""

import errno
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import dask
import pytest
from distributed import Security

from pipeline.cli.failures import AGAIN
from pipeline.engine import dask_executor
from pipeline.engine.dask_executor import Dask
from pipeline.engine.executor import Serial
from pipeline.engine.worker_processes import WorkerProcesses
from pipeline.errors import StageError, StoreError
from pipeline.store import publish
from pipeline.store.validate import problems_below
from tests.engine.tiny_stages import (
    CONSOLE,
    DiesOpening,
    MakeNoise,
    Notes,
    TakeMean,
    digest,
    objects,
    plan_of,
    published,
    request,
    run,
    work_of,
)


def test_workers_close_sessions_in_the_thread_that_opened_them_and_leave_no_files(tmp_path, monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    run(request(tmp_path / "data", stage=Notes(tmp_path), executor=WorkerProcesses(1)))
    assert [path.name for path in tmp_path.glob("closed*")] == ["closed there"]
    assert (tmp_path / "threads").read_text() == "1"
    assert "OMP_NUM_THREADS" not in os.environ
    temporary = Path((tmp_path / "temporary").read_text())
    assert temporary.parent.parent.name == f"vt-pipeline-{os.getuid()}"
    assert not temporary.parent.exists()


def test_a_run_whose_worker_died_while_idle_continues(tmp_path):
    work, units = work_of(request(tmp_path))
    with WorkerProcesses(1) as executor:
        assert len([*executor.run(work, units[:1])]) == 1
        (worker,) = executor._idle
        os.kill(worker.process.pid, signal.SIGKILL)
        results = [*executor.run(work, units[1:])]
        assert [(result.failure, result.bug) for result in results] == [(None, None)] * 4


def test_no_more_workers_start_than_there_are_units_and_they_are_reused(tmp_path):
    work, units = work_of(request(tmp_path))
    with WorkerProcesses(3) as executor:
        list(executor.run(work, units[:1]))
        (first,) = executor._idle
        list(executor.run(work, units[1:3]))
        assert first in executor._idle
        assert len(executor._idle) == 2
        processes = [worker.process for worker in executor._idle]
    assert not any(process.is_alive() for process in processes)


def test_reused_workers_read_replaced_inputs(tmp_path):
    with WorkerProcesses(1) as executor:
        for samples in (50, 60):
            run(request(tmp_path, settings={"samples": samples}))
            assert plan_of(request(tmp_path, TakeMean(), executor=executor)).make(CONSOLE).objects == 5


def test_only_the_crashing_and_hanging_objects_fail_each_after_two_tries(tmp_path):
    items = objects(6, b="crash", d="hang", e=f"crash-once {tmp_path / 'crashed'}")
    run(request(tmp_path, items=items, settings={"object_seconds": 2}, executor=WorkerProcesses(2)))
    failed = {item.object_id: failure.reason for item in items if (failure := published(tmp_path).failure(item.object_id))}
    assert failed.keys() == {"b", "d"}
    assert "its process died each time" in failed["b"]
    assert "it took longer than object_seconds = 2; simplify the mesh, or raise it" in failed["d"]


def test_closing_at_once_ends_workers_in_the_middle_of_an_object(tmp_path):
    work, units = work_of(request(tmp_path))
    executor = WorkerProcesses(2)
    results = executor.run(work, units)
    next(results)
    processes = [worker.process for worker in executor._busy]
    executor.__exit__(StageError)
    assert processes
    assert not any(process.is_alive() for process in processes)


def test_semaphores_of_killed_workers_are_released_without_a_warning(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from tests.engine.tiny_stages import *\nfrom pipeline.engine.worker_processes import WorkerProcesses\nif __name__ == '__main__':\n"
        "    work, units = work_of(request(Path(sys.argv[1]), HoldsLock()))\n    executor = WorkerProcesses(1)\n"
        "    next(executor.run(work, units))\n    executor.__exit__(StageError)\n"
    )
    ended = subprocess.run([sys.executable, script, tmp_path / "data"], capture_output=True, text=True, check=True)
    assert ended.stderr == ""


def _workers(process: int) -> list[int]:
    """List the worker processes of a process."""
    workers = []
    for children in Path(f"/proc/{process}/task").glob("*/children"):
        with suppress(OSError):
            workers += [
                int(child) for child in children.read_text().split() if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()
            ]
    return workers


@pytest.mark.parametrize(("number", "status", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")])
def test_run_stopped_while_its_workers_start_ends_with_one_line(tmp_path, number, status, word):
    command = [sys.executable, "-m", "pipeline", "run", "sample-surfaces", "--data", str(tmp_path), "--workers", "2"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True) as started:
        while started.poll() is None and not _workers(started.pid):
            time.sleep(0.01)
        if number == signal.SIGINT:
            os.killpg(started.pid, number)  # as a terminal does
        else:
            started.send_signal(number)
        _, message = started.communicate()
    assert (started.returncode, message) == (status, f"error: {word}; {AGAIN}\n")


def test_workers_of_a_killed_run_end_in_the_middle_of_an_object(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from tests.engine.tiny_stages import *\nfrom pipeline.engine.worker_processes import WorkerProcesses\n"
        f"items = objects(2, a='sleep {tmp_path}/asleep-a', b='sleep {tmp_path}/asleep-b')\n"
        "if __name__ == '__main__':\n    run(request(Path(sys.argv[1]), items=items, executor=WorkerProcesses(2)))\n"
    )
    with subprocess.Popen([sys.executable, str(script), str(tmp_path / "data")]) as started:
        while started.poll() is None and len(list(tmp_path.glob("asleep*"))) < 2:
            time.sleep(0.01)
        workers = _workers(started.pid)
        started.kill()
    assert len(workers) == 2
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline and any(Path(f"/proc/{worker}/cmdline").exists() for worker in workers):
        time.sleep(0.01)
    assert not any(Path(f"/proc/{worker}/cmdline").exists() for worker in workers)


def test_session_that_cannot_open_ends_the_run_and_fails_no_object(tmp_path):
    for executor in (Serial(), WorkerProcesses(1)):
        with pytest.raises(StageError, match="make-noise cannot start: OSError: no device; `vt-pipeline doctor`"):
            run(request(tmp_path, stage=MakeNoise(broken=True), executor=executor))
    assert run(request(tmp_path)) == 5


def test_worker_that_dies_while_opening_its_session_is_replaced_once(tmp_path):
    assert run(request(tmp_path, stage=DiesOpening(tmp_path / "flag", once=True), executor=WorkerProcesses(1))) == 5
    with pytest.raises(StageError, match=r"make-noise cannot start: its process died each time .* fewer --workers"):
        run(request(tmp_path, stage=DiesOpening(tmp_path / "none", once=False), executor=WorkerProcesses(1), seed=1))


@pytest.mark.parametrize("executor", [Serial(), WorkerProcesses(1)])
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
    work, units = work_of(request(tmp_path / "there"))
    cluster = _Cluster(tmp_path)
    for name, file in (("CA_FILE", cluster.certificate), ("CLIENT__CERT", cluster.certificate), ("CLIENT__KEY", cluster.key)):
        monkeypatch.setenv(f"DASK_DISTRIBUTED__COMM__TLS__{name}", str(file))
    dask.config.refresh()
    cluster.start()
    try:
        with Dask(cluster.address) as executor:
            results = executor.run(work, units)
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


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("tcp://127.0.0.1:9", "there is no Dask scheduler with workers at tcp://127.0.0.1:9: "),
        ("tls://127.0.0.1:9", "tls://127.0.0.1:9 wants certificates, Dask's settings name none; see "),
        ("nowhere", "there is no Dask scheduler with workers at nowhere: missing port number"),
        ("smtp://x:1", "there is no Dask scheduler with workers at smtp://x:1: unknown address scheme 'smtp'"),
    ],
)
def test_unreachable_or_invalid_scheduler_is_named(monkeypatch, address, why):
    monkeypatch.setattr(dask_executor, "CONNECT_SECONDS", 1)
    with pytest.raises(StageError) as error:
        Dask(address).processes  # noqa: B018
    assert str(error.value).startswith(why)
