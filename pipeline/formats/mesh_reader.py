"""Read mesh files and MJCF in a separate process: each in a fork of it, which the kernel stops at a limit of memory and of time.

A small file may need more memory or time than there is. A limit set in this process would apply to its other threads, and to memory that
it had freed before; an exception stops no native code. A fork of a process that does nothing else starts equal for every file.
"""

import atexit
import errno
import json
import os
import pickle
import resource
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from pipeline.errors import InvalidInput, StageError
from pipeline.kernels.geometry.mesh import Mesh

BYTES = 5 * 2**28  # memory that reading a file may take: a COLLADA file of a million faces takes 1.1 GB, other formats less
SECONDS = 60  # processor time that reading a file may take: a million faces take 7 s at most
REMEDY = "decimate the mesh, name each part once, or write it as binary PLY"
START = "from pipeline.formats.mesh_reader import serve; serve()"  # the program of the process
_lock = threading.Lock()
_readers: dict[int, subprocess.Popen[bytes]] = {}  # the reader of each process that has one, by its number: a fork of it starts its own


def load_mesh(file: Path, root: Path | None = None) -> Mesh:
    """Read the triangles of a file, in its own units and axes, with their materials and textures.

    The files that it names must be below `root`, by default its folder. It is read in a process limited to `BYTES` and `SECONDS`.
    """
    mesh: Mesh = read_within_limits("mesh", file, os.path.abspath(root or file.parent))
    return mesh


def read_within_limits(
    kind: str,  # "mesh" or "mjcf"
    file: Path,
    text: str,  # the folder that a mesh's files must be below; the root of an MJCF
) -> Any:
    """Read a file in a process limited to `BYTES` and `SECONDS`; return what its parser returns, or raise its error."""
    with _lock:
        reader = _readers.get(os.getpid())
        if reader and reader.poll() is not None:
            end_reader()
            reader = None
        reader = reader or _readers.setdefault(os.getpid(), _start())
        try:
            answer = _ask(reader, kind, file, text)
        except BaseException:  # part of an answer may be unread
            end_reader()
            raise
    if isinstance(answer, Exception):
        raise answer
    return answer


def end_reader() -> None:
    """End the reader of this process, even while it reads."""
    if reader := _readers.pop(os.getpid(), None):
        if reader.poll() is None:
            os.killpg(reader.pid, signal.SIGKILL)  # with the fork that reads a file
        reader.communicate()


def serve() -> None:
    """Read the files that standard input names; end when there are no more, or with the status of a fork that failed."""
    import PIL.Image

    PIL.Image.init()  # as the modules below: what readers need is imported before a limit applies
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    for line in sys.stdin.buffer:
        kind, file, text, size, seconds = json.loads(line)
        read = _parser(kind)
        if not (fork := os.fork()):
            _answer(lambda: read(Path(file), text), answers, {resource.RLIMIT_DATA: size, resource.RLIMIT_CPU: seconds})  # noqa: B023
        if status := os.waitstatus_to_exitcode(os.waitpid(fork, 0)[1]):
            os._exit(status if status > 0 else 128 - status)


def _parser(kind: str) -> Callable[[Path, str], Any]:
    if kind == "mjcf":
        from pipeline.formats.mjcf import parse_mjcf

        return parse_mjcf
    from pipeline.formats.mesh_file import parse_mesh

    return parse_mesh


def _answer(read: Callable[[], Any], answers: IO[bytes], limits: dict[int, int]) -> None:
    """Write what was read or an error, and end this process."""
    try:
        for kind, limit in {**limits, resource.RLIMIT_CORE: 0}.items():
            soft, hard = resource.getrlimit(kind)
            resource.setrlimit(kind, (min([limit, *(current for current in (soft, hard) if current != resource.RLIM_INFINITY)]), hard))
        answer: Any
        try:
            answer = read()
        except InvalidInput as error:
            answer = InvalidInput(str(error))
        except MemoryError:
            raise
        except Exception:
            answer = RuntimeError(traceback.format_exc())
        pickle.dump(answer, answers, protocol=5)
        answers.flush()
        os._exit(0)
    except MemoryError:
        os._exit(errno.ENOMEM)
    except BrokenPipeError:  # the process that asked was ended
        pass
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(errno.EIO)


def _start() -> subprocess.Popen[bytes]:
    """Start a reader with one thread that finds the same modules; it ends when this process does."""
    module_folders = [str(Path(__file__).parents[2]), *(folder for folder in sys.path if folder)]
    return subprocess.Popen(
        [sys.executable, "-P", "-W", "ignore", "-c", START],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(module_folders), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        start_new_session=True,  # Ctrl-C is for this process
    )


def _ask(reader: subprocess.Popen[bytes], kind: str, file: Path, text: str) -> Any:
    if reader.stdin is None or reader.stdout is None:
        raise ValueError("a reader without pipes")
    try:
        reader.stdin.write(json.dumps([kind, os.path.abspath(file), text, BYTES, SECONDS]).encode() + b"\n")
        reader.stdin.flush()
        return pickle.load(reader.stdout)
    except (BrokenPipeError, EOFError, pickle.UnpicklingError):  # it ended before, or in, its answer
        return _failure(file.name, reader.wait())


def _failure(name: str, status: int) -> InvalidInput:
    """Explain why a file could not be read, from its reader's exit status."""
    reasons = {
        errno.ENOMEM: f"needs more than {BYTES / 1e9:.1f} GB of memory to read; {REMEDY}",
        128 + signal.SIGXCPU: f"takes more than {SECONDS} s of processor time to read; {REMEDY}",
        128 + signal.SIGKILL: "was being read when the kernel ended its reader, as it does when memory is short; "
        f"{REMEDY}, or use fewer workers",
    }
    if status in reasons:
        return InvalidInput(f"{name} {reasons[status]}")
    if status > 128:
        return InvalidInput(f"{name} ends the process that reads it ({signal.Signals(status - 128).name}); write it with another program")
    raise StageError(f"the process that reads mesh files ended with status {status}; what it printed says why")


atexit.register(end_reader)
