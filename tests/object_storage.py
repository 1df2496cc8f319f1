"""Object storage for tests: moto's server in this process, and a proxy that answers with faults."""

import http.client
import logging
import os
import shutil
import socket
import struct
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from pipeline.store import storage

BUCKET = "bucket"
SECONDS = 60


@contextmanager
def moto_server() -> Iterator[str]:
    """Run moto's server in threads of this process; yield its address."""
    from moto.server import ThreadedMotoServer

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    server.stop()


def wait_until(happens: Callable[[], bool]) -> None:
    """Wait until a condition holds; raise AssertionError after a minute."""
    deadline = time.monotonic() + SECONDS
    while not happens():
        assert time.monotonic() < deadline
        time.sleep(0.1)


def make_bucket(address: str) -> None:
    """Make the bucket."""
    wait_until(lambda: _answers_put(f"{address}/{BUCKET}"))


def _answers_put(url: str) -> bool:
    try:
        urllib.request.urlopen(urllib.request.Request(url, method="PUT"), timeout=5).close()
    except OSError:
        return False
    return True


def use(monkeypatch: pytest.MonkeyPatch, address: str, cache: Path) -> None:
    """Configure a server for this process and its children through the environment, as a user does."""
    variables = {"AWS_ENDPOINT_URL": address, "AWS_ACCESS_KEY_ID": "anyone", "AWS_SECRET_ACCESS_KEY": "anything"}
    for name, value in (variables | {"AWS_REGION": "us-east-1", "AWS_ALLOW_HTTP": "true", "XDG_CACHE_HOME": str(cache)}).items():
        monkeypatch.setenv(name, value)
    storage.client_of.cache_clear()


@dataclass(frozen=True)
class Answer:
    """A status in place of the server's answer, None to break the connection; `late` after the server has handled the request."""

    status: int | None
    late: bool = False


@dataclass
class Proxy:
    """A server before another one: `fault` may answer a request (method, path) in its place or after it.

    Attributes
    ----------
    seen
        Every request.
    """

    address: str
    fault: Callable[[str, str], Answer | None] = lambda method, path: None
    seen: list[tuple[str, str]] = field(default_factory=list)


@contextmanager
def proxy(target: str) -> Iterator[Proxy]:
    """Run a proxy before a server."""
    host = target.removeprefix("http://")

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def handle_any(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            running.seen.append((self.command, self.path))
            answer = running.fault(self.command, self.path)
            if answer is None or answer.late:
                connection = http.client.HTTPConnection(host, timeout=30)
                connection.request(self.command, self.path, body, dict(self.headers))
                response = connection.getresponse()
                status, headers, content = response.status, response.getheaders(), response.read()
                connection.close()
            if answer is not None and answer.status is None:
                self.connection.setsockopt(
                    socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0)
                )  # resets the connection, as a killed process does
                self.close_connection = True
                self.connection.close()
                return
            if answer is not None:
                status, headers, content = answer.status, [], b""
            self.send_response(status)
            for name, value in headers:
                if name.lower() not in ("transfer-encoding", "connection", "content-length", "date", "server"):
                    self.send_header(name, value)
            length = dict((name.lower(), value) for name, value in headers).get("content-length") if self.command == "HEAD" else None
            self.send_header("Content-Length", length or str(len(content)))
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(content)

        do_GET = do_PUT = do_POST = do_HEAD = do_DELETE = handle_any

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    running = Proxy(f"http://127.0.0.1:{server.server_address[1]}")
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield running
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def clear(folder: Path) -> None:
    """Clear the local cache of object storage, as on another machine."""
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(folder)
