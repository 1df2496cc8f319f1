"""A real Slurm of one node on this machine: munged, slurmctld and slurmd, started in a folder and ended afterwards."""

import os
import secrets
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

CORES = 2
SETTINGS = """
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=defer_batch,sched_interval=5,sched_min_interval=0
SlurmdParameters=config_overrides
ReturnToService=2
KillWait=5
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory=4000 State=UNKNOWN
PartitionName=cpu Nodes={host} MaxTime=INFINITE State=UP
"""


@contextmanager
def one_node_slurm(folder: Path) -> Iterator[None]:
    """Run a Slurm with one partition `cpu` in `folder`, which must be short; commands find it by SLURM_CONF."""
    assert os.geteuid() == 0, "only root can start a Slurm"
    for name in ("state", "spool"):
        (folder / name).mkdir(parents=True)
    host, settings = socket.gethostname().partition(".")[0], folder / "slurm.conf"
    settings.write_text(SETTINGS.format(host=host, folder=folder, ports=_free_ports(), cores=CORES))
    key = folder / "munge.key"
    key.touch(0o600)
    key.write_bytes(secrets.token_bytes(128))
    places = [f"--{option}={folder}/munge.{end}" for option, end in (("key-file", "key"), ("socket", "socket"), ("pid-file", "pid"))]
    files = [f"--{option}={folder}/munge.{end}" for option, end in (("log-file", "log"), ("seed-file", "seed"))]
    before = os.environ.get("SLURM_CONF")
    with ExitStack() as daemons:
        daemons.enter_context(_daemon("munged", "--foreground", "--force", *places, *files))
        _wait_for((folder / "munge.socket").exists, "munged")
        os.environ["SLURM_CONF"] = str(settings)
        try:
            daemons.enter_context(_daemon("slurmctld", "-D", "-L", f"{folder}/slurmctld.log"))
            daemons.enter_context(_daemon("slurmd", "-D", "-L", f"{folder}/slurmd.log"))
            _wait_for(lambda: "idle" in _said("sinfo", "--noheader", "--format=%T"), f"the node, see {folder}/slurmd.log")
            try:
                yield
            finally:
                subprocess.run(["scancel", "--user=root"], check=False)
                _wait_for(lambda: not _said("squeue", "--noheader"), "the end of all jobs")
        finally:
            os.environ.pop("SLURM_CONF")
            os.environ.update({"SLURM_CONF": before} if before else {})


@contextmanager
def _daemon(name: str, *arguments: str) -> Iterator[None]:
    """Run a program until the end."""
    program = shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin:/sbin")
    assert program, f"{name} is not installed; `make test-slurm` installs it"
    process = subprocess.Popen([program, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _said(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


def _wait_for(there: Callable[[], bool], what: str, seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < deadline, f"waited {seconds:.0f} s for {what}"
        time.sleep(0.2)


def _free_ports() -> list[int]:
    with socket.socket() as one, socket.socket() as other:
        for each in (one, other):
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in (one, other)]
