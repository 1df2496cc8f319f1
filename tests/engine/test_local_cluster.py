"""Local clusters are closed to other users of the machine, and Ctrl-C ends a run while its workers start."""

from __future__ import annotations

import asyncio
import datetime
import os
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import distributed.security
import pytest
from distributed import Client
from distributed.comm import connect

from pipeline.engine.dask_executor import Dask
from pipeline.engine.local_cluster import OneRunSecurity
from pipeline.store.temporary import private_folder


async def _answers(address: str, arguments: dict[str, Any]) -> bool:
    """Return whether a server answers; one that answers would also run code."""
    try:
        comm = await connect(address, timeout=0.3, **arguments)
        await comm.write({"op": "identity", "reply": True})
        return "id" in await comm.read()
    except OSError:
        return False


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """Start a cluster whose temporary folder is shared and holds another user's Dask folder, with the clock ahead at start."""
    folder = tmp_path_factory.mktemp("tmp")
    tomorrow = SimpleNamespace(now=lambda tz: datetime.datetime.now(tz) + datetime.timedelta(days=1))
    (folder / "dask-scratch-space").mkdir()
    for path in (folder, folder / "dask-scratch-space"):
        path.chmod(0o777)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(folder))
        patch.setattr(distributed.security, "datetime", SimpleNamespace(**vars(datetime) | {"datetime": tomorrow}))
        with Dask() as executor:
            yield executor._connect(2)


def test_scheduler_and_workers_refuse_clients_without_the_certificate_of_the_run(client):
    own, other = (security.get_connection_args("client") for security in (client.security, OneRunSecurity.temporary()))
    nannies = [worker.address for worker in client.cluster.workers.values()]
    for address in [client.scheduler.address, *client.nthreads(), *nannies]:
        assert asyncio.run(_answers(address, own))
        assert not asyncio.run(_answers(address, other))
        assert not asyncio.run(_answers(address.replace("tls://", "tcp://"), {}))


def test_web_servers_of_a_run_serve_no_pages(client):
    ports = [client.cluster.scheduler.http_server.port]
    ports += [worker["services"]["dashboard"] for worker in client.scheduler_info()["workers"].values()]
    for port in ports:
        for page in ("info/main/workers.html", "status", "health", "metrics"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(f"http://127.0.0.1:{port}/{page}", timeout=60)


def test_workers_import_from_no_folder_that_other_users_can_write(client):
    (imported,) = client.run(lambda: sys.path).values()
    below = [Path(folder).relative_to(tempfile.tempdir) for folder in (*sys.path, *imported) if folder.startswith(f"{tempfile.tempdir}/")]
    assert {path.parts[0] for path in below} == {f"vt-pipeline-{os.getuid()}"}
    assert private_folder().stat().st_mode & 0o777 == 0o700


def _children(process: int) -> list[bytes]:
    """Return the command lines of a process's children."""
    files = []
    for thread in Path(f"/proc/{process}/task").iterdir():
        files += [Path(f"/proc/{child}/cmdline") for child in (thread / "children").read_text().split()]
    return [path.read_bytes() for path in files if path.exists()]


@pytest.mark.parametrize(("number", "status", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")])
def test_run_stopped_while_its_workers_start_ends_with_one_line(tmp_path, number, status, word):
    command = [sys.executable, "-m", "pipeline", "run", "sample-surfaces", "--data", str(tmp_path), "--workers", "2"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True) as run:
        while run.poll() is None and not any(b"spawn_main" in child for child in _children(run.pid)):
            time.sleep(0.01)
        if number == signal.SIGINT:
            os.killpg(run.pid, number)  # as a terminal does
        else:
            run.send_signal(number)
        _, message = run.communicate()
    assert (run.returncode, message) == (status, f"error: {word}; run the same command again, what is finished is kept\n")
