"""Every stage run from the command line gives the same digests in object storage as on a disk, even if the server restarts."""

import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pipeline.dataset.grasp_dataset import GraspDataset
from pipeline.dataset.labelled import open_artifact
from pipeline.store.storage import as_location, exists, files_below, list_folder
from stages.registry import GRASP_STAGES
from tests.object_storage import BUCKET, make_bucket, moto_server, use, wait_until
from tests.test_pipeline import digests, made, manifest, run_of, vt  # noqa: F401 (fixtures)


class SeaweedServer:
    """SeaweedFS's S3 on one machine; `kill` keeps the stored objects."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.ports = [_free_port() for _ in range(4)]
        self.address = f"http://127.0.0.1:{self.ports[3]}"
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start the server and wait until it answers."""
        master, volume, filer, s3 = self.ports
        (self.folder / "stored").mkdir(parents=True, exist_ok=True)
        ports = [f"-master.port={master}", f"-volume.port={volume}", f"-filer.port={filer}", f"-s3.port={s3}"]
        ports += [f"-{name}.port.grpc={_free_port()}" for name in ("master", "volume", "filer", "s3")]
        command = [Path(sys.executable).parent / "weed", "server", f"-dir={self.folder}/stored", "-s3", "-ip=127.0.0.1", *ports]
        with (self.folder / "log").open("ab") as log:
            self.process = subprocess.Popen([*command, "-master.volumeSizeLimitMB=64", "-volume.max=0"], stdout=log, stderr=log)
        wait_until(lambda: _answers(self.address) and _answers(f"http://127.0.0.1:{master}/dir/assign"))

    def kill(self) -> None:
        """Kill the server as if its machine were lost."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()


def _answers(url: str) -> bool:
    try:
        urllib.request.urlopen(url, timeout=5).close()
    except urllib.error.HTTPError as error:
        return error.code < 500 and error.code != 404
    except OSError:
        return False
    return True


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@pytest.fixture(scope="module")
def seaweed(tmp_path_factory) -> Iterator[SeaweedServer]:
    server = SeaweedServer(tmp_path_factory.mktemp("seaweed"))
    server.start()
    make_bucket(server.address)
    yield server
    server.kill()


@pytest.fixture(scope="module", params=["moto", "seaweed"])
def address(request) -> Iterator[str]:
    if request.param == "seaweed":
        yield request.getfixturevalue("seaweed").address
    else:
        with moto_server() as address:
            make_bucket(address)
            yield address


def test_every_stage_gives_the_same_digests_as_on_a_disk(address, manifest, made, monkeypatch, tmp_path):  # noqa: F811
    use(monkeypatch, address, tmp_path / "cache")
    data = f"s3://{BUCKET}/four"
    for stage in GRASP_STAGES:
        vt(*run_of(stage, manifest, data, "--workers", "2", "--shards", "3"))
    assert digests(data) == digests(made)
    for stage in GRASP_STAGES:
        assert "up to date" in vt(*run_of(stage, manifest, data))
    assert vt("validate", data).count(": valid") == 8 * 3 + 5 - 8 * _empty(data)
    assert files_below(as_location(data) / ".work") == {}
    here, there = (GraspDataset(directory, ["tactile_image", "local_points"], split=None) for directory in (made, data))
    assert all(np.array_equal(here[item][name], there[item][name]) for item in (0, 7) for name in ("tactile_image", "local_points"))
    assert open_artifact(data, "touch").depth.equals(open_artifact(made, "touch").depth)
    vt("summary", data)
    vt("report", data, "--most", "1")
    vt("predict", tmp_path / "out.obj", "--data", data, "--object", "duck")
    assert all(exists(as_location(data) / name) for name in ("contact-sheet.png", "report/index.html", "report/objects/duck.mesh.js"))
    assert "0 removed" in vt("collect-garbage", data)


def _empty(data: str) -> int:
    """Count the shards, of three, that hold no object."""
    return 3 - sum(name.endswith(".json") for name in list_folder(as_location(data) / "surfaces"))


def test_restarted_server_is_waited_for(seaweed, manifest, made, monkeypatch, tmp_path):  # noqa: F811
    use(monkeypatch, seaweed.address, tmp_path / "cache")
    data, stages = f"s3://{BUCKET}/killed", [name for name in GRASP_STAGES if name.startswith(("sample", "simulate"))]
    finished = threading.Event()

    def kill_and_start() -> None:
        while not finished.wait(8):
            seaweed.kill()
            time.sleep(3)
            seaweed.start()

    killer = threading.Thread(target=kill_and_start)
    killer.start()
    try:
        for stage in stages:
            vt(*run_of(stage, manifest, data, "--executor", "serial"))
    finally:
        finished.set()
        killer.join()
    artifacts = ("surfaces", "grasps", "touch")
    assert {name: digests(data)[name] for name in artifacts} == {name: digests(made)[name] for name in artifacts}
    assert "not valid" not in vt("validate", data)
