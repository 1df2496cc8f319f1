"""What other users of the machine can do to a run's workers, and Ctrl-C while they start."""

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
    """Whether a server, which would run code as well, answers."""
    try:
        comm = await connect(address, timeout=0.3, **arguments)
        await comm.write({"op": "identity", "reply": True})
        return "id" in await comm.read()
    except OSError:
        return False


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """Make a run's scratch folder, its clock set back since, in a shared folder where other users own Dask's default."""
    folder = tmp_path_factory.mktemp("tmp")
    tomorrow = SimpleNamespace(now=lambda tz: datetime.datetime.now(tz) + datetime.timedelta(days=1))
    (folder / "dask-scratch-space").mkdir()
    for path in (folder, folder / "dask-scratch-space"):
        path.chmod(0o777)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(folder))
        patch.setattr(distributed.security, "datetime", SimpleNamespace(**vars(datetime) | {"datetime": tomorrow}))
        with Dask() as executor:
            yield executor._connect()


def test_whoever_lacks_the_certificate_of_a_run_can_use_neither_its_scheduler_nor_its_workers(client):
    own, other = (security.get_connection_args("client") for security in (client.security, OneRunSecurity.temporary()))
    nannies = [worker.address for worker in client.cluster.workers.values()]
    for address in [client.scheduler.address, *client.nthreads(), *nannies]:
        assert asyncio.run(_answers(address, own))
        assert not asyncio.run(_answers(address, other))
        assert not asyncio.run(_answers(address.replace("tls://", "tcp://"), {}))


def test_web_servers_of_a_run_show_nothing(client):
    ports = [client.cluster.scheduler.http_server.port]
    ports += [worker["services"]["dashboard"] for worker in client.scheduler_info()["workers"].values()]
    for port in ports:
        for page in ("info/main/workers.html", "status", "health", "metrics"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(f"http://127.0.0.1:{port}/{page}", timeout=60)


def test_python_looks_for_modules_in_no_folder_that_other_users_write_to(client):
    (theirs,) = client.run(lambda: sys.path).values()
    below = [Path(folder).relative_to(tempfile.tempdir) for folder in (*sys.path, *theirs) if folder.startswith(f"{tempfile.tempdir}/")]
    assert {path.parts[0] for path in below} == {f"vt-pipeline-{os.getuid()}"}
    assert private_folder().stat().st_mode & 0o777 == 0o700


def _children(process: int) -> list[bytes]:
    """Return the command lines of a process's children."""
    found = []
    for thread in Path(f"/proc/{process}/task").iterdir():
        found += [Path(f"/proc/{child}/cmdline") for child in (thread / "children").read_text().split()]
    return [path.read_bytes() for path in found if path.exists()]


@pytest.mark.parametrize(("number", "status", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")])
def test_a_run_that_is_stopped_while_its_workers_start_ends_in_words(tmp_path, number, status, word):
    command = [sys.executable, "-m", "pipeline", "run", "sample-surfaces", "--data", str(tmp_path), "--workers", "2"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True) as run:
        while run.poll() is None and not any(b"spawn_main" in child for child in _children(run.pid)):
            time.sleep(0.01)
        if number == signal.SIGINT:
            os.killpg(run.pid, number)  # as a terminal does
        else:
            run.send_signal(number)
        _, said = run.communicate()
    assert (run.returncode, said) == (status, f"error: {word}; what is finished is kept, run the same command to continue\n")
