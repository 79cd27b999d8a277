"""Hostile pages and requests to `streamkit view`: all are refused, each reason is logged once.

A pipeline with control=true and a server are processes of their own. Hostile clients send mutated websocket
messages, requests to control without the token, wrong tokens, Hosts and Origins, and paths that leave the
page's folder; a hostile zenoh session sends mutated requests to KEY/control. After each batch a good page has
to get records, and a good request its reply, within 10 s. Exit code 1 where the server or the pipeline ends,
hangs, prints a traceback, logs a line twice, leaks descriptors or grows, or sets what is malformed.

Run it:  python benchmarks/fuzz_view.py [--messages N] [--seed N]
"""

from __future__ import annotations

import argparse
import http.client
import json
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import zenoh
from view_load import message_head
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from streamkit_zenoh.configuration import SessionSettings
from streamkit_zenoh.session import close_session, open_session

KEY = f"fuzz/view/{os.getpid()}"
LAUNCH = f"videotestsrc is-live=true ! framediff name=moving ! zenohsink key={KEY} control=true frame-rate=2"
STREAMKIT = str(Path(sys.executable).with_name("streamkit"))
GOOD = {"element": "moving", "property": "min-score", "value": 0.25}
ANSWER_LIMIT_S = 10.0
BATCH = 100
GROWTH_LIMIT_MB = 16.0
REFUSED = (400, 401, 403, 404, 307, 405)
REQUESTS = (GOOD, GOOD | {"value": 0.9}, {"element": "zenohsink0", "property": "key", "value": "x"})
MESSAGES = (
    {"taken": 1}, {"select": 0}, {"back": 5}, {"stills": False}, {"control": None},
    {"control": GOOD, "taken": 1},
    *({"control": request} for request in REQUESTS),
)  # fmt: skip
PATHS = (
    "/../server.py", "/%2e%2e/%2e%2e/etc/passwd", "/..%2f..%2fetc/passwd", "//etc/passwd", "/page/../main.js",
    "/%00", "/index.html%00.py", "/\\..\\server.py", "/.git/config", "/feed/../x", "/%c0%ae%c0%ae/server.py",
)  # fmt: skip
HOSTS = ("evil.example", "127.0.0.1.evil.example", "", "[::1", "localhost@evil.example", "0x7f000001.evil")
ORIGINS = ("http://evil.example", "null", "file://", "http://127.0.0.1:1", "https://localhost.evil", "")


class Server(NamedTuple):
    """Where the server listens, the token that it printed, and what it logs."""

    host: str
    port: int
    token: str
    log: Path

    def get(self, path: str, headers: dict[str, str]) -> int:
        """The status of a response; 400 where the server ends the connection."""
        connection = http.client.HTTPConnection(self.host, self.port, timeout=ANSWER_LIMIT_S)
        try:
            connection.putrequest("GET", path, skip_host="Host" in headers)
            for name, value in headers.items():
                connection.putheader(name, value)
            connection.endheaders()
            return connection.getresponse().status
        except (http.client.HTTPException, ConnectionError):
            return 400
        finally:
            connection.close()

    def page(self, cookie: str = "", origin: str | None = None) -> ClientConnection:
        """A websocket, by default as the page opens it."""
        headers = {"Cookie": f"streamkit_view_{self.port}={cookie}"} if cookie else {}
        own = f"http://{self.host}:{self.port}"
        return connect(
            f"ws://{self.host}:{self.port}/feed", origin=own if origin is None else origin,
            additional_headers=headers, compression=None, max_size=None, open_timeout=ANSWER_LIMIT_S,
        )  # type: ignore[arg-type]  # fmt: skip


def mutated(seeds: tuple[Any, ...], numbers: random.Random) -> str | bytes:
    """A message like one of the seeds, with some bytes replaced, repeated or cut."""
    data = bytearray(json.dumps(numbers.choice(seeds)).encode())
    for _ in range(numbers.randrange(1, 6)):
        at = numbers.randrange(len(data))
        piece = numbers.choice([b"[", b'"', b"{", b"-1", b"1e999", b"\\ud800", b"null", numbers.randbytes(3)])
        data[at : at + numbers.randrange(3)] = piece * numbers.choice([1, 1, 1, 300])
    kept = bytes(data[: numbers.randrange(1, len(data) + 1)])
    return kept if numbers.random() < 0.2 else kept.decode("utf-8", "replace")


def attack_page(server: Server, numbers: random.Random) -> None:
    """One hostile page: some messages, until the server closes it."""
    cookie = numbers.choice(["", "wrong", server.token[:-1], "%ff", "x" * 900])
    with server.page(cookie) as page:
        for _ in range(numbers.randrange(1, 4)):
            try:
                page.send(mutated(MESSAGES, numbers))
            except ConnectionClosed:
                return


def attack_http(server: Server, numbers: random.Random) -> None:
    """One hostile request; raises `AssertionError` if it is answered."""
    kind = numbers.randrange(4)
    own = f"{server.host}:{server.port}"
    if kind == 0:
        status = server.get(numbers.choice(PATHS), {})
    elif kind == 1:
        status = server.get("/", {"Host": numbers.choice(HOSTS)})
    elif kind == 2:
        wrong = numbers.choice(["", "x", server.token[1:], server.token + "0", "%00", "a" * 3000])
        status = server.get(f"/?token={wrong}", {"Host": own})
        assert not wrong or status in REFUSED, f"a wrong token is answered with {status}"
        return
    else:
        try:
            server.page(origin=numbers.choice(ORIGINS)).close()
            status = 101
        except InvalidStatus as refused:
            status = refused.response.status_code
        except (OSError, ConnectionClosed):
            status = 400
    assert status in REFUSED, f"hostile request {kind} is answered with {status}"


def attack_zenoh(session: zenoh.Session, numbers: random.Random) -> None:
    """One hostile request at KEY/control; each has a reply."""
    message = mutated(REQUESTS, numbers)
    payload = message.encode() if isinstance(message, str) else message
    payload *= numbers.choice([1, 1, 1, 200])
    replies = [reply.ok for reply in session.get(f"{KEY}/control", payload=payload, timeout=ANSWER_LIMIT_S)]
    assert replies, "a hostile request stays without reply"
    assert replies[0] is not None
    reply = json.loads(replies[0].payload.to_bytes())
    if "error" not in reply:
        (found,) = reply["properties"]
        is_sound = (found["element"], found["property"]) == ("moving", "min-score") and 0 <= found[
            "value"
        ] <= 1
        assert is_sound, f"{payload[:200]!r} is accepted: {found}"
        json.loads(payload)


def check_good(server: Server) -> float:
    """Time until a good page has a record and the reply to a good request, s."""
    began = time.monotonic()
    waiting = {"tracks", "control"}
    with server.page(server.token) as page:
        page.send(json.dumps({"control": GOOD}))
        while waiting and time.monotonic() - began < ANSWER_LIMIT_S:
            found = message_head(page.recv(ANSWER_LIMIT_S))
            waiting.discard(found["type"])
            if found["type"] == "control":
                assert found["body"]["reply"]["properties"][0]["value"] == GOOD["value"], found
    assert not waiting, f"a good page gets no {' and no '.join(waiting)}"
    return time.monotonic() - began


def memory_mb(process: int) -> float:
    """Resident memory of a process."""
    found = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{process}/status").read_text())
    return int(found[1]) / 1024 if found else 0.0


def descriptors(process: int) -> int:
    """Open files and sockets of a process."""
    return len(os.listdir(f"/proc/{process}/fd"))


def run(messages: int, seed: int) -> None:
    """Starts pipeline and server, attacks them, and reports."""
    numbers = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder, "view.txt")
        pipeline_log = Path(folder, "pipeline.txt")
        with log.open("w") as view_file, pipeline_log.open("w") as pipeline_file:
            publisher = subprocess.Popen(
                [STREAMKIT, "launch", LAUNCH], stderr=pipeline_file, stdout=pipeline_file
            )
            view = subprocess.Popen(
                [STREAMKIT, "view", KEY, "--listen", "127.0.0.1:0"],
                stdout=subprocess.PIPE,
                stderr=view_file,
                text=True,
            )
        session = open_session(SessionSettings())
        try:
            assert view.stdout is not None
            url = urlsplit(view.stdout.readline().split()[1])
            server = Server(url.hostname or "", url.port or 0, url.query.removeprefix("token="), log)
            wait_until_ready(server)
            slowest, sent = 0.0, 0
            before = [(memory_mb(process.pid), descriptors(process.pid)) for process in (view, publisher)]
            while sent < messages:
                for _ in range(BATCH):
                    numbers.choice([attack_page, attack_http])(server, numbers)
                    attack_zenoh(session, numbers)
                sent += 2 * BATCH
                slowest = max(slowest, check_good(server))
                assert view.poll() is None, "the server has ended"
                assert publisher.poll() is None, "the pipeline has ended"
                print(
                    f"{sent} hostile messages; a good page is served in {slowest:.2f} s at most", flush=True
                )
            ends = ((view, "server", before[0]), (publisher, "pipeline", before[1]))
            for process, name, (memory, files) in ends:
                growth, more = memory_mb(process.pid) - memory, descriptors(process.pid) - files
                print(f"{name}: memory {growth:+.1f} MB, descriptors {more:+d}")
                assert growth < GROWTH_LIMIT_MB, f"the {name} has grown"
                assert more <= 4, f"the {name} leaks descriptors"
        finally:
            close_session(session, 5.0)
            for process in (view, publisher):
                process.send_signal(signal.SIGTERM)
                process.wait(20)
        lines = log.read_text().splitlines()
        assert len(lines) == len(set(lines)), f"a line is logged twice: {lines[:40]}"
        assert "Traceback" not in log.read_text() + pipeline_log.read_text()
        assert server.token not in log.read_text() + pipeline_log.read_text(), "the token is logged"
        print("logged by the server:", *lines, sep="\n  ")


def wait_until_ready(server: Server) -> None:
    """Waits until the pipeline publishes; it may compile first."""
    deadline = time.monotonic() + 120
    while True:
        try:
            check_good(server)
        except (AssertionError, KeyError, TimeoutError):
            assert time.monotonic() < deadline, "the pipeline does not start"
        else:
            return


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--messages", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=22)
    chosen = parser.parse_args()
    run(chosen.messages, chosen.seed)
