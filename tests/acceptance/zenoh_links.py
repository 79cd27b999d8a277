"""Processes and links for the zenoh acceptance tests: a router, a proxy that records traffic."""

from __future__ import annotations

import contextlib
import json
import select
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

BINARY = Path(sys.executable).with_name("streamkit")
ROUTER = """
import json, sys, zenoh
config = zenoh.Config()
for key, value in json.loads(sys.argv[1]).items():
    config.insert_json5(key, json.dumps(value))
session = zenoh.open(config)
print("up", flush=True)
sys.stdin.read()
session.close()
"""


class Router:
    """A zenoh session in router mode, in a process of its own, that can be killed and started again."""

    def __init__(self, endpoint: str, **settings: Any) -> None:
        self.endpoint = endpoint
        self._config = {
            "mode": "router",
            "listen/endpoints": [endpoint],
            "scouting/multicast/enabled": False,
            **{name.replace("__", "/"): value for name, value in settings.items()},
        }
        self._process: subprocess.Popen[str] | None = None
        self.start()

    def start(self) -> None:
        """Starts it and waits until it listens."""
        self._process = subprocess.Popen(
            [sys.executable, "-c", ROUTER, json.dumps(self._config)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "up\n"

    def kill(self) -> None:
        """Kills it."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate(timeout=10)
            self._process = None


@contextlib.contextmanager
def router(endpoint: str, **settings: Any) -> Iterator[Router]:
    """A router that runs during the block."""
    running = Router(endpoint, **settings)
    try:
        yield running
    finally:
        running.kill()


class Proxy:
    """Forwards TCP connections to another port, and records the traffic."""

    def __init__(self, target_port: int) -> None:
        self.seen = bytearray()
        self._target_port = target_port
        self._ended = threading.Event()
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._server.getsockname()[1]
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        """Cuts all connections."""
        self._ended.set()
        self._thread.join(10)
        self._server.close()

    def _run(self) -> None:
        pairs: dict[socket.socket, socket.socket] = {}
        while not self._ended.is_set():
            for ready in select.select([self._server, *pairs], [], [], 0.05)[0]:
                if ready is self._server:
                    near = self._server.accept()[0]
                    try:
                        far = socket.create_connection(("127.0.0.1", self._target_port), 2)
                    except OSError:
                        near.close()
                        continue
                    pairs[near], pairs[far] = far, near
                elif ready in pairs:
                    self._pass_on(ready, pairs)
        for end in pairs:
            end.close()

    def _pass_on(self, ready: socket.socket, pairs: dict[socket.socket, socket.socket]) -> None:
        other = pairs[ready]
        try:
            data = ready.recv(65536)
            other.sendall(data)
        except OSError:
            data = b""
        self.seen += data
        if not data:
            for end in (ready, other):
                end.close()
                pairs.pop(end, None)
