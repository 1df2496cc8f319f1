"""A Dask scheduler and workers on this machine, which its other users can neither reach nor read."""

import logging
import multiprocessing
import os
import signal
import threading
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from contextlib import suppress
from multiprocessing import resource_tracker
from typing import Any

import dask
from distributed import Client, LocalCluster, Security

from pipeline.console import pluralise
from pipeline.engine.dask_worker import LocalWorker
from pipeline.errors import StageError
from pipeline.store.temporary import private_folder

LOCAL: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": 0,  # each death is reported, with the time that its object had taken
    "distributed.scheduler.worker-ttl": None,  # native code may keep a worker silent for long; `object_seconds` limits it
    "distributed.worker.profile.enabled": False,  # the profile of a second takes 0.1 MB, and 1000 of them are kept
    "distributed.comm.timeouts.connect": "60s",
    # Dask would have malloc return each free 64 kB to the system: arrays of a megabyte then cost a third of an object's time.
    "distributed.nanny.pre-spawn-environ": {"OMP_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1},
    # Dask's web pages need no password. The servers start anyway, but without routes they serve nothing.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}

LOOPBACK = "127.0.0.1:0"
"""Where the scheduler's web server listens: any free port, which other machines do not reach."""

HINT = "run again, with fewer --workers where memory is short, or with --executor serial"
"""The remedy if workers of this machine do not start."""

ANY_TIME = 0x200000
"""OpenSSL's X509_V_FLAG_NO_CHECK_TIME: a run's certificates do not depend on the clock, which may be set meanwhile."""


class OneRunSecurity(Security):  # type: ignore[misc]  # which has no types
    """Certificates of one run: the key is only in the memory of its processes, and nobody can connect to them without it."""

    def get_connection_args(self, role: str) -> dict[str, Any]:
        """Return the options that a process connects with."""
        return _at_any_time(super().get_connection_args(role))

    def get_listen_args(self, role: str) -> dict[str, Any]:
        """Return the options that a process listens with."""
        return _at_any_time(super().get_listen_args(role))


def _at_any_time(arguments: dict[str, Any]) -> dict[str, Any]:
    arguments["ssl_context"].verify_flags |= ANY_TIME
    return arguments


def start_workers(processes: int) -> Client:
    """Start a scheduler in this process, and workers, and connect to them; try again if one is killed as it starts."""
    try:
        with suppress(RuntimeError):
            return _start(processes)
        return _start(processes)
    except TimeoutError as error:
        raise StageError(f"{pluralise(processes, 'worker process')} did not start in time on a machine this busy; {HINT}") from error
    except RuntimeError as error:
        raise StageError(f"worker processes cannot be started ({error}); {HINT}") from error


def _start(processes: int) -> Client:
    """Start them in another thread, so that this one receives Ctrl-C, and kills what was started."""
    existing, interrupted, connecting = set(multiprocessing.active_children()), threading.Event(), threading.Lock()

    def start() -> Client:
        resource_tracker.ensure_running()  # started later in that thread, it would unblock SIGINT
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # workers inherit it: Ctrl-C is for this process, which ends them
        cluster = _cluster_of(processes)
        with connecting:
            if not interrupted.is_set():
                client = Client(cluster, set_as_default=False)
                client.register_plugin(LocalWorker())
        if interrupted.is_set():
            cluster.close()
        return client

    with ThreadPoolExecutor(1) as thread:
        starting = thread.submit(start)
        try:
            return starting.result()
        except KeyboardInterrupt:  # SIGTERM, too
            interrupted.set()
            while wait_for([starting], timeout=0.05).not_done:
                if connecting.acquire(blocking=False):
                    for child in set(multiprocessing.active_children()) - existing:
                        child.kill()
                    connecting.release()
            raise


class _Cluster(LocalCluster):  # type: ignore[misc]
    """A cluster that accepts the scheduler's message of a lost worker that it has already removed; in Dask's own it is an error."""

    def _update_worker_status(self, op: str, msg: object) -> None:
        with suppress(KeyError):
            super()._update_worker_status(op, msg)


def _cluster_of(processes: int) -> LocalCluster:
    folder = str(private_folder(dask.config.get("temporary-directory", None)))
    with dask.config.set(LOCAL | {"temporary-directory": folder}):
        return _Cluster(
            n_workers=processes,
            threads_per_worker=1,
            memory_limit=0,
            security=OneRunSecurity.temporary(),
            dashboard_address=LOOPBACK,
            scheduler_kwargs={"dashboard": False},
            local_directory=folder,  # these settings hold for workers that join later, too
            config=LOCAL,
            silence_logs=logging.CRITICAL,
        )


def end_workers(client: Client) -> None:
    """End the workers and the scheduler that were started here, at once."""
    cluster = client.cluster
    for worker in cluster.workers.values():
        worker.close_gracefully()  # else another is started in its place
        with suppress(ProcessLookupError, TypeError):  # it has ended, or was not started yet
            os.kill(worker.pid, signal.SIGKILL)
    for end in (client, cluster):
        with suppress(TimeoutError):  # on a busy machine: the work is done, and the workers are gone
            end.close()
