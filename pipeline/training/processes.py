"""Start the processes of a training on this machine, end them with it, and let them exchange words."""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import torch
import torch.distributed

from pipeline.errors import StageError
from pipeline.store.temporary import temporary_folder

if TYPE_CHECKING:  # importing it takes seconds, which a run that is up to date need not spend
    from lightning_fabric import Fabric

RESUME_HINT = "run the same command again: it goes on from its last checkpoint"
"""The remedy in messages about a training that ended early."""

WORD = 4096
"""Maximum number of bytes that a process broadcasts."""

LOST = ("onnection closed", "onnection reset", "roken pipe", "imed out", "onnection refused")
"""Parts of gloo's messages of lost connections between processes, for which it has no error type."""

REPORT_DELAY = 3.0
"""Seconds by which the other processes delay their end after one was killed, so that their launcher reports the killed one."""


@contextmanager
def end_children_on_interrupt() -> Iterator[None]:
    """End the processes that are started in this context when it is interrupted; otherwise it would wait for them.

    Their temporary files are in a folder that other users cannot reach: torch unpickles one of them when a process has failed.
    """
    children, environment_folder, tempfile_folder = set(multiprocessing.active_children()), os.environ.get("TMPDIR"), tempfile.tempdir
    with temporary_folder() as folder:
        os.environ["TMPDIR"], tempfile.tempdir = str(folder), None
        try:
            yield
        except KeyboardInterrupt:  # SIGTERM, too
            for child in set(multiprocessing.active_children()) - children:
                child.terminate()
            raise
        finally:
            del os.environ["TMPDIR"]
            os.environ |= {} if environment_folder is None else {"TMPDIR": environment_folder}
            tempfile.tempdir = tempfile_folder


def end_with_parent() -> None:
    """Let this process, started by a training, end when its parent is killed.

    The system then sends SIGINT, as torch asked it to, and a job in a shell's background would ignore that.
    """
    if parent := multiprocessing.parent_process():
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if os.getppid() != parent.pid:  # it was killed before
            os.kill(os.getpid(), signal.SIGINT)


@contextmanager
def lost_peers_as_stage_error(fabric: Fabric, name: str) -> Iterator[None]:
    """Raise a `StageError` if another process of the training ended, after giving its launcher time to report the reason."""
    try:
        yield
    except RuntimeError as error:
        is_lost = "gloo" in str(error) and any(words in str(error) for words in LOST)
        if fabric.world_size == 1 or not (is_lost or isinstance(error, torch.distributed.DistError)):
            raise
        time.sleep(REPORT_DELAY)
        reason = str(error).strip().splitlines()[0]
        raise StageError(
            f"{name}: process {fabric.global_rank} of {fabric.world_size} lost the others ({reason}); see their messages, and {RESUME_HINT}"
        ) from error


def gather_strings(fabric: Fabric, word: str) -> list[str]:
    """Gather a string of each process, as bytes: torch would unpickle it, although any machine of the network may have sent it."""
    padded = torch.tensor(list(word.encode().ljust(WORD)), dtype=torch.uint8, device=fabric.device)
    rows: Any = fabric.all_gather(padded)
    return [bytes(row).decode(errors="replace").rstrip() for row in rows.reshape(-1, WORD).tolist()]
