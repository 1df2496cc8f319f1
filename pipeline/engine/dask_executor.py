"""Jobs on Dask: worker processes of this machine, or of any cluster that a scheduler's address leads to."""

from __future__ import annotations

import logging
import os
import pickle
import signal
import threading
import time
import uuid
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

import dask
from distributed import CancelledError, Client, Future, KilledWorker, LocalCluster, wait

from pipeline.engine import dask_worker, keys
from pipeline.engine.executor import Executor
from pipeline.engine.session import MORE_MEMORY, Work, record_crash
from pipeline.engine.unit import Unit
from pipeline.errors import StageError
from pipeline.store.row_files import Result

TRIES = 2
"""A process that dies may have been killed from outside; the object is to blame when it dies again."""

LOCAL = {
    "distributed.scheduler.allowed-failures": 0,  # each death is told, with the time that its object had taken
    "distributed.scheduler.worker-ttl": None,  # native code may keep a worker silent for long; `object_seconds` limits it
    "distributed.worker.profile.enabled": False,  # what it notes of a second takes 0.1 MB, and 1000 of them are kept
    "distributed.comm.timeouts.connect": "60s",
    # Dask would have malloc give back each 64 kB that are free: arrays of a megabyte then cost a third of an object's time.
    "distributed.nanny.pre-spawn-environ": {"OMP_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1},
}

CONNECT_SECONDS = 10
"""After which there is no scheduler at an address."""
JOIN_SECONDS = 60
"""After which no worker is going to join."""
LOOK_SECONDS = 10
"""Between two looks at which workers there are, while no object is finished."""

BUNDLE_SECONDS = 2.0
"""What a worker is given at once takes about so long: a hundred times the way to it and back."""

HINT = "run again, with fewer --workers where memory is short, or with --executor serial"
"""What helps where workers of this machine do not start."""
NOBODY_ELSE = "127.0.0.1:0"
"""Where Dask's web servers listen: any free port, which other machines do not reach."""


class Dask(Executor):
    """Worker processes, one object after the other each; they may come and go. Nothing is started before the first job.

    Parameters
    ----------
    processes
        Workers to start on this machine.
    scheduler
        The address of a running scheduler whose workers see the same files, instead.
    """

    def __init__(self, processes: int = 1, scheduler: str | None = None) -> None:
        self._count, self._scheduler = processes, scheduler
        self._tries = 1 if scheduler else TRIES  # a scheduler that is not ours has tried more than once itself
        self._cluster: LocalCluster | None = None
        self._client: Client | None = None

    @property
    def processes(self) -> int:
        """The workers to be started, or those that the scheduler has."""
        return max(1, len(self._connect().nthreads())) if self._scheduler else self._count

    def run(self, work: Work, units: Sequence[Unit]) -> Iterator[Result]:
        """Do jobs: each worker has a bundle at a time; after a crash its jobs are tried alone, to know which one is to blame."""
        client = self._connect()
        # Each run opens sessions of its own: those of the last one know its inputs.
        packed = pickle.dumps((uuid.uuid4(), keys.code_hash(work.stage), work))
        self._open_sessions(client, packed, work.stage.name)
        limit, waiting, suspects = work.settings.object_seconds, deque(units), deque[Unit]()
        done, seconds = 0, 0.0
        survived: dict[str, list[float]] = {}  # seconds until its process died, of each time that an object was tried alone
        running: dict[Future, tuple[list[Unit], float]] = {}
        while waiting or suspects or running:
            workers = self._workers(client)
            while (waiting or suspects) and len(running) < workers:
                size = _bundle_size(done / max(seconds, 1e-3), len(waiting) / workers)
                bundle = [suspects.popleft()] if suspects else [waiting.popleft() for _ in range(size)]
                future = client.submit(dask_worker.do, packed, bundle, limit, key=f"{work.stage.name}-{uuid.uuid4()}", pure=False)
                running[future] = (bundle, time.monotonic())
            with client.as_current(), suppress(TimeoutError, CancelledError):
                wait([*running], timeout=LOOK_SECONDS, return_when="FIRST_COMPLETED")
            for future in [future for future in running if future.done()]:
                bundle, began = running.pop(future)
                if future.cancelled():  # the scheduler was started again, and knows of nothing
                    waiting.extend(bundle)
                    continue
                try:
                    results: list[Result] = future.result()
                except KilledWorker:
                    if len(bundle) > 1:
                        suspects.extend(bundle)
                        continue
                    tries = survived.setdefault(bundle[0].name, [])
                    tries.append(time.monotonic() - began)
                    if len(tries) < self._tries:
                        suspects.extend(bundle)
                        continue
                    results = [record_crash(work, bundle[0], _why(max(tries), limit))]
                done, seconds = done + len(results), seconds + sum(result.seconds for result in results)
                yield from results

    def _connect(self) -> Client:
        """Connect to the scheduler, or start workers on this machine."""
        if self._client is None:
            for library in ("distributed", "asyncio"):  # what they would say of workers that die, and of runs that are ended, is said here
                logging.getLogger(library).setLevel(logging.CRITICAL)
            if self._scheduler:
                self._client = _client_of(self._scheduler)
            else:
                try:
                    self._cluster = _local_cluster(self._count)
                    self._client = Client(self._cluster, set_as_default=False)
                    self._client.register_plugin(dask_worker.LocalWorker())
                except TimeoutError as error:
                    raise StageError(f"{self._count} worker processes did not start in time on a machine this busy; {HINT}") from error
        return self._client

    def _workers(self, client: Client) -> int:
        """Count the workers; one that died takes some seconds to be replaced."""
        try:
            deadline = time.monotonic() + JOIN_SECONDS
            while not (workers := client.nthreads()):
                if time.monotonic() > deadline:
                    raise TimeoutError(f"none has joined for {JOIN_SECONDS} s")
                if self._cluster is not None:  # what watches over a worker gives up where that dies as soon as it has joined
                    self._cluster.scale(self._count)
                with suppress(TimeoutError):
                    client.wait_for_workers(1, timeout=LOOK_SECONDS)
            return len(workers)
        except OSError as error:
            raise StageError(f"Dask's scheduler or its workers are gone ({error}); what is finished is kept, run again") from error

    def _open_sessions(self, client: Client, packed: bytes, stage: str) -> None:
        """Open the stage's session, where it can be opened, in every worker; those that come later open theirs with their first job."""
        for _ in range(self._tries):
            with suppress(KilledWorker):
                client.gather([client.submit(dask_worker.open_ahead, packed, pure=False) for _ in range(self._workers(client))])
                return
        raise StageError(
            f"{stage} cannot start: its process died each time while it opened (killed, or memory ran out?); "
            "run again, with fewer --workers where memory is short"
        )

    def close(self, *, at_once: bool) -> None:
        """End the workers that were started here; those of a scheduler go on.

        They are killed once their sessions are closed: what an interpreter tidies up at its end takes half a second.
        """
        client, cluster, self._client, self._cluster = self._client, self._cluster, None, None
        if client is not None and cluster is not None and not at_once:
            closed = [client.submit(dask_worker.end_session, workers=[address], pure=False) for address in client.nthreads()]
            client.gather(closed, errors="skip")
        for worker in cluster.workers.values() if cluster is not None else ():
            worker.auto_restart = False
            with suppress(ProcessLookupError, TypeError):  # it is gone, or was not started yet
                os.kill(worker.pid, signal.SIGKILL)
        for end in (client, cluster):
            if end is not None:
                with suppress(TimeoutError):  # on a busy machine: the work is done, and the workers are gone
                    end.close()


def _client_of(scheduler: str) -> Client:
    """Connect to a scheduler that has workers."""
    try:
        client = Client(scheduler, set_as_default=False, timeout=CONNECT_SECONDS)
        client.wait_for_workers(1, timeout=JOIN_SECONDS)
    except (OSError, ValueError) as error:
        raise StageError(f"there is no Dask scheduler with workers at {scheduler}: {error}; start both first") from error
    if any(threads > 1 for threads in client.nthreads().values()):
        raise StageError(f"workers of {scheduler} have several threads; start them with --nthreads 1, and more of them")
    return client


def _local_cluster(processes: int) -> LocalCluster:
    """Start a scheduler in this process, and workers; once more where somebody kills one while it starts."""

    def start() -> LocalCluster:
        with dask.config.set(LOCAL), _interrupts_ignored():  # workers inherit it: Ctrl-C is for this process, which ends them
            return LocalCluster(
                n_workers=processes,
                threads_per_worker=1,
                memory_limit=0,
                dashboard_address=NOBODY_ELSE,
                worker_dashboard_address=NOBODY_ELSE,
                silence_logs=logging.CRITICAL,
            )

    with suppress(RuntimeError):
        return start()
    try:
        return start()
    except RuntimeError as error:
        raise StageError(f"worker processes cannot be started ({error}); {HINT}") from error


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ignore Ctrl-C for a moment, where this thread may say so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _bundle_size(rate: float, share: float) -> int:
    """How many jobs a worker is given at once, from how many it does per second, and its share of those that are left.

    As many as take some seconds, so that waiting for the next ones does not count; fewer towards the end, so that all workers end together.
    """
    return max(1, int(min(BUNDLE_SECONDS * rate, share / 2)))


def _why(seconds: float, limit: float) -> str:
    """Why an object's processes died, by the longest time that one of them lived."""
    if seconds >= limit:
        return f"it took longer than object_seconds = {limit}; simplify the mesh, or raise it and run again with --retry"
    return f"its process died each time (a crash in a native library, or memory ran out); {MORE_MEMORY}"
