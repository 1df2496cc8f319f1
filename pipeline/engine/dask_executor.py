"""Process units on the workers of a Dask scheduler."""

import time
import uuid
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property

from distributed import CancelledError, Client, Future, KilledWorker, Security, wait
from distributed.comm import parse_address, parse_host_port
from distributed.comm.registry import get_backend

from pipeline.engine.executor import Executor, Work, opening_error, pack, process_unit, record_crash
from pipeline.engine.stage import Unit
from pipeline.errors import StageError
from pipeline.store.rows import Result

CONNECT_SECONDS = 10  # time limit for connecting to a scheduler
JOIN_SECONDS = 60  # time limit for the first worker to join
POLL_SECONDS = 10  # interval between two counts of the workers, while no object is finished


class Dask(Executor):
    """The workers of a running scheduler, which see the same files; they may come and go, and go on afterwards."""

    def __init__(self, scheduler: str) -> None:
        self.scheduler = scheduler

    @property
    def processes(self) -> int:
        return max(1, len(self._client.nthreads()))

    @cached_property
    def _client(self) -> Client:
        """The connection to the scheduler, which must have workers."""
        try:
            protocol, address = parse_address(self.scheduler)
            get_backend(protocol)
            parse_host_port(address)
            if protocol == "tls" and not Security().get_connection_args("client").get("ssl_context"):
                raise StageError(f"{self.scheduler} wants certificates, Dask's settings name none; see docs/guide/speed-and-accuracy.md")
            client = Client(self.scheduler, set_as_default=False, timeout=CONNECT_SECONDS)
            client.wait_for_workers(1, timeout=JOIN_SECONDS)
        except (OSError, ValueError) as error:
            raise StageError(f"there is no Dask scheduler with workers at {self.scheduler}: {error}; start both first") from error
        if any(threads > 1 for threads in client.nthreads().values()):
            raise StageError(f"workers of {self.scheduler} have several threads; start them with --nthreads 1, and more of them")
        return client

    def run(self, work: Work, units: Sequence[Unit]) -> Iterator[Result]:
        """Process units, one at a time per worker. An object whose workers die has failed: the scheduler has tried several."""
        packed, waiting, limit = pack(work), deque(units), work.settings.object_seconds
        try:  # workers that join later open their session with their first unit
            self._client.gather([self._client.submit(process_unit, packed, None, limit, pure=False) for _ in range(self._workers())])
        except KilledWorker:
            raise opening_error(work.stage.name) from None
        running: dict[Future, tuple[Unit, float]] = {}
        while waiting or running:
            workers = self._workers()
            while waiting and len(running) < workers:
                unit = waiting.popleft()
                key = f"{work.stage.name}-{uuid.uuid4()}"
                running[self._client.submit(process_unit, packed, unit, limit, key=key, pure=False)] = unit, time.monotonic()
            with self._client.as_current(), suppress(TimeoutError, CancelledError):
                wait([*running], timeout=POLL_SECONDS, return_when="FIRST_COMPLETED")
            for future in [future for future in running if future.done()]:
                unit, began = running.pop(future)
                if future.cancelled():  # the scheduler was restarted, and has lost its tasks
                    waiting.append(unit)
                    continue
                try:
                    result = future.result()
                except KilledWorker:
                    result = record_crash(work, unit, timed_out=time.monotonic() - began >= limit)
                yield result

    def _workers(self) -> int:
        """Count the workers; one that died takes some seconds to be replaced."""
        try:
            if not self._client.nthreads():
                self._client.wait_for_workers(1, timeout=JOIN_SECONDS)
            return len(self._client.nthreads())
        except OSError as error:
            raise StageError(f"Dask's scheduler or its workers are gone ({error}); what is finished is kept, run again") from error

    def __exit__(self, *_: object) -> None:
        if client := self.__dict__.pop("_client", None):
            client.close()
