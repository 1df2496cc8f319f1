"""Process units with Dask: on worker processes of this machine, or of any cluster with a scheduler's address."""

import logging
import pickle
import time
import uuid
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress

from distributed import CancelledError, Client, Future, KilledWorker, Security, wait
from distributed.comm import parse_address, parse_host_port
from distributed.comm.registry import get_backend

from pipeline.engine import dask_worker, keys
from pipeline.engine.executor import Executor
from pipeline.engine.local_cluster import end_workers, start_workers
from pipeline.engine.session import MORE_MEMORY, Work, record_crash
from pipeline.engine.unit import Unit
from pipeline.errors import StageError
from pipeline.store.row_files import Result

TRIES = 2
"""Attempts per object: a process that dies may have been killed from outside; if it dies again, the object has failed."""

CONNECT_SECONDS = 10
"""Time limit for connecting to a scheduler."""
JOIN_SECONDS = 60
"""Time limit for the first worker to join."""
POLL_SECONDS = 10
"""Interval between two counts of the workers, while no object is finished."""

BUNDLE_SECONDS = 2.0
"""Target duration of a bundle of units: a hundred times the round trip to a worker."""


class Dask(Executor):
    """Worker processes that each process one object after the other; they may come and go.

    None is started before the first unit.
    """

    def __init__(
        self,
        processes: int = 1,  # workers to start on this machine
        scheduler: str | None = None,  # instead: the address of a running one, whose workers see the same files
    ) -> None:
        self._count, self._scheduler = processes, scheduler
        self._tries = 1 if scheduler else TRIES  # a scheduler that is not ours has tried more than once itself
        self._client: Client | None = None
        self._started = 0

    @property
    def processes(self) -> int:
        """The workers to be started, or those that the scheduler has."""
        return max(1, len(self._connect(1).nthreads())) if self._scheduler else self._count

    def run(self, work: Work, units: Sequence[Unit]) -> Iterator[Result]:
        """Process units: each worker has one bundle at a time; after a crash its units are tried one by one, to find the faulty one."""
        client = self._connect(len(units))
        # Each run opens its own sessions: those of the previous run hold its inputs.
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
                future = client.submit(
                    dask_worker.process_units, packed, bundle, limit, key=f"{work.stage.name}-{uuid.uuid4()}", pure=False
                )
                running[future] = (bundle, time.monotonic())
            with client.as_current(), suppress(TimeoutError, CancelledError):
                wait([*running], timeout=POLL_SECONDS, return_when="FIRST_COMPLETED")
            for future in [future for future in running if future.done()]:
                bundle, began = running.pop(future)
                if future.cancelled():  # the scheduler was restarted, and has lost its tasks
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
                    results = [record_crash(work, bundle[0], _crash_reason(max(tries), limit))]
                done, seconds = done + len(results), seconds + sum(result.seconds for result in results)
                yield from results

    def _connect(self, units: int) -> Client:
        """Connect to the scheduler, or start workers on this machine, no more than there are units."""
        wanted = min(self._count, units)
        if self._client is None:
            for library in ("distributed", "asyncio"):  # dead workers and ended runs are reported here
                logging.getLogger(library).setLevel(logging.CRITICAL)
            self._client = _client_of(self._scheduler) if self._scheduler else start_workers(wanted)
            self._started = wanted
        elif self._client.cluster is not None and self._started < wanted:
            self._client.cluster.scale(wanted)
            self._started = wanted
        return self._client

    def _workers(self, client: Client) -> int:
        """Count the workers; one that died takes some seconds to be replaced."""
        try:
            deadline = time.monotonic() + JOIN_SECONDS
            while not (workers := client.nthreads()):
                if time.monotonic() > deadline:
                    raise TimeoutError(f"none has joined for {JOIN_SECONDS} s")
                if client.cluster is not None:  # Dask's nanny gives up on a worker that dies as soon as it has joined
                    client.cluster.scale(self._started)
                with suppress(TimeoutError):
                    client.wait_for_workers(1, timeout=POLL_SECONDS)
            return len(workers)
        except OSError as error:
            raise StageError(f"Dask's scheduler or its workers are gone ({error}); what is finished is kept, run again") from error

    def _open_sessions(self, client: Client, packed: bytes, stage: str) -> None:
        """Open the stage's session in every worker; workers that join later open theirs with their first unit."""
        for _ in range(self._tries):
            with suppress(KilledWorker):
                client.gather([client.submit(dask_worker.process_units, packed, [], 0.0, pure=False) for _ in range(self._workers(client))])
                return
        raise StageError(
            f"{stage} cannot start: its process died each time while it opened (killed, or memory ran out?); "
            "run again, with fewer --workers where memory is short"
        )

    def close(self, *, at_once: bool) -> None:
        """End the workers that were started here; those of a scheduler go on.

        They are killed once their sessions are closed: an orderly exit of the interpreter takes half a second.
        """
        client, self._client = self._client, None
        if client is None:
            return
        if client.cluster is None:
            client.close()
            return
        if not at_once:
            closed = [client.submit(dask_worker.end_session, workers=[address], pure=False) for address in client.nthreads()]
            client.gather(closed, errors="skip")
        end_workers(client)


def _client_of(scheduler: str) -> Client:
    """Connect to a scheduler that has workers."""
    try:
        protocol, address = parse_address(scheduler)
        get_backend(protocol)
        parse_host_port(address)
        if protocol == "tls" and not Security().get_connection_args("client").get("ssl_context"):
            raise StageError(
                f"{scheduler} asks for certificates, and Dask's configuration names none; see docs/guide/speed-and-accuracy.md"
            )
        client = Client(scheduler, set_as_default=False, timeout=CONNECT_SECONDS)
        client.wait_for_workers(1, timeout=JOIN_SECONDS)
    except (OSError, ValueError) as error:
        raise StageError(f"there is no Dask scheduler with workers at {scheduler}: {error}; start both first") from error
    if any(threads > 1 for threads in client.nthreads().values()):
        raise StageError(f"workers of {scheduler} have several threads; start them with --nthreads 1, and more of them")
    return client


def _bundle_size(rate: float, share: float) -> int:
    """Compute how many units a worker is sent at once, from its units per second and its share of those remaining.

    They take some seconds, so that waiting for the next ones does not matter; fewer towards the end, so that all
    workers end together.
    """
    return max(1, int(min(BUNDLE_SECONDS * rate, share / 2)))


def _crash_reason(seconds: float, limit: float) -> str:
    """Explain why an object's processes died, from the longest time that one of them lived."""
    if seconds >= limit:
        return f"it took longer than object_seconds = {limit}; simplify the mesh, or raise it and run again with --retry"
    return f"its process died each time (a crash in a native library, or memory ran out); {MORE_MEMORY}"
