"""The server refuses strangers and nonsense, logs each reason once, and stays up."""

from __future__ import annotations

import http.client
import json
import random
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from typer.testing import CliRunner
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from streamkit import Pipeline
from streamkit.cli.main import make_app
from streamkit_view import hub
from streamkit_view.messages import InvalidAnswer, read_answer
from streamkit_view.server import page_files

STREAMKIT = str(Path(sys.executable).with_name("streamkit"))


def request(server: Any, path: str, **headers: str) -> http.client.HTTPResponse:
    """The response to a GET, with headers as given."""
    connection = http.client.HTTPConnection(*server.address, timeout=10)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    response = connection.getresponse()
    response.body = response.read()  # type: ignore[attr-defined]
    connection.close()
    return response


def open_page(address: tuple[str, int], **options: Any) -> ClientConnection:
    """A websocket as the page opens it."""
    host, port = address
    options = {"origin": f"http://{host}:{port}", "compression": None, "max_size": None, **options}
    return connect(f"ws://{host}:{port}/feed", open_timeout=10, close_timeout=2, **options)


def test_the_page_and_its_files_are_served_with_a_strict_policy(server: Any) -> None:
    """No script or style but the page's own files, no other address."""
    response = request(server, "/")
    assert response.status == 200
    policy = response.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert response.headers["X-Content-Type-Options"] == "nosniff"
    for name in page_files():
        assert request(server, f"/{name}").body == page_files()[name]  # type: ignore[attr-defined]


def test_the_page_names_no_other_address() -> None:
    """No request leaves the machine, and no markup is made of text."""
    for name, content in page_files().items():
        if (vendored := files("streamkit_view") / "vendor" / name).is_file():
            assert content == vendored.read_bytes()  # as published: test_earth watches what it requests
            continue
        text = content.decode().replace("http://www.w3.org/2000/svg", "")
        assert not re.search(
            r"https?://|innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(", text
        ), name
    assert b"style=" not in page_files()["index.html"]
    assert not re.search(rb"<script(?![^>]*src=)", page_files()["index.html"])


@pytest.mark.parametrize(
    "path",
    [
        "/../server.py", "/%2e%2e/server.py", "/..%2fserver.py", "//etc/passwd", "/....//server.py",
        "/server.py", "/%00", "/page/index.html", "/feed", "/%ff%fe", "/index.html/", "/style.css/../main.js",
        "/" + "a" * 4000,
    ],
)  # fmt: skip
def test_nothing_but_the_files_of_the_page_can_be_read(server: Any, path: str) -> None:
    """Files are found by name among those read at the start."""
    assert request(server, path).status in (307, 404)


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8090", "127.0.0.1.evil.example", "", "[::1", "a:b"]
)
def test_another_host_is_refused(server: Any, host: str) -> None:
    """A site that resolves its own name to this machine reads nothing."""
    assert request(server, "/", Host=host).status == 400


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "file://", None])
def test_a_page_of_another_site_gets_no_websocket(server: Any, origin: str | None) -> None:
    """Browsers let any site open websockets; the server must look at Origin."""
    with pytest.raises(InvalidStatus) as refused:
        open_page(server.address, origin=origin)
    assert refused.value.response.status_code == 403


def test_beyond_loopback_everything_needs_the_token(start_view: Callable[..., Any], key: str) -> None:
    """The address that is printed has it; the first response moves it into a cookie."""
    server = start_view(key, listen="0.0.0.0:0")
    token = urlsplit(server.url).query.removeprefix("token=")
    assert len(token) >= 32
    for path in ("/", "/main.js", "/feed"):
        assert request(server, path).status == 401
    for wrong in ("x", token[:-1], token + "x", "%ff", ""):
        assert request(server, f"/?token={wrong}").status in (401, 403)
        assert request(server, "/", Cookie=f"streamkit_view_{server.address[1]}={wrong}").status == 401
    with pytest.raises(InvalidStatus):
        open_page(server.address)
    response = request(server, f"/?token={token}")
    assert (response.status, response.headers["Location"]) == (303, "/")
    cookie = response.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "samesite=strict" in cookie.lower()
    assert request(server, "/", Cookie=cookie.partition(";")[0]).status == 200
    with open_page(server.address, additional_headers={"Cookie": cookie.partition(";")[0]}) as page:
        assert json.loads(page.recv(10))["type"] == "hello"


def kind_of(data: str | bytes) -> str:
    """The kind of a message to a page."""
    header = data if isinstance(data, str) else data[4 : 4 + int.from_bytes(data[:4], "little")]
    return str(json.loads(header)["type"])


def reply_to(page: ClientConnection, request_: object) -> dict[str, Any]:
    """Sends a request to control, and gives the reply."""
    page.send(json.dumps({"control": request_}))
    while True:
        message = page.recv(10)
        if isinstance(message, str) and (found := json.loads(message))["type"] == "control":
            assert found["body"]["request"] == request_
            return dict(found["body"]["reply"])


@pytest.mark.timeout(120)
def test_control_needs_the_token_also_on_loopback(
    start_view: Callable[..., Any], key: str, wait_for: Callable[..., Any]
) -> None:
    """Without it a page only looks; with it a live property is set, or the property's error shown."""
    server = start_view(key)
    cookie = request(server, server.url[server.url.index("/?") :]).headers["Set-Cookie"].partition(";")[0]
    change = {"element": "moving", "property": "min-score", "value": 0.5}
    text = f"videotestsrc is-live=true ! framediff name=moving ! zenohsink key={key} control=true"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        with open_page(server.address) as page:  # later pages begin with the last record, behind the greeting
            wait_for(lambda: kind_of(page.recv(10)) == "tracks")
        for headers in ({}, {"Cookie": f"streamkit_view_{server.address[1]}=wrong"}):
            with open_page(server.address, additional_headers=headers) as page:
                assert json.loads(page.recv(10))["body"] == {"control": False, "basemap": None}
                assert "changes need the token" in reply_to(page, change)["error"]
        with open_page(server.address, additional_headers={"Cookie": cookie}) as page:
            assert json.loads(page.recv(10))["body"] == {"control": True, "basemap": None}
            wait_for(lambda: "properties" in reply_to(page, None))
            assert pipeline["moving"].min_score == 0.0
            assert reply_to(page, change)["properties"][0]["value"] == 0.5
            assert pipeline["moving"].min_score == 0.5
            error = reply_to(page, change | {"value": 7})["error"]
            assert error == "moving: property min-score cannot be 7.0: it takes float 0.0..1.0"


def test_a_page_that_floods_the_pipeline_with_requests_is_refused(server: Any) -> None:
    """Few requests wait for their replies."""
    cookie = request(server, server.url[server.url.index("/?") :]).headers["Set-Cookie"].partition(";")[0]
    with open_page(server.address, additional_headers={"Cookie": cookie}) as page:
        for _ in range(100):
            page.send(json.dumps({"control": None}))
        assert closing_code(page) == 1008


def hostile(random_numbers: random.Random) -> str | bytes:
    """A message that no page sends."""
    values: list[Any] = [
        -1,
        1.5,
        True,
        None,
        "1",
        [],
        {},
        10**30,
        2**53,
        {"taken": 1},
        {"element": "a", "property": "b", "value": [1]},
        {"element": "a" * 900, "property": "b"},
        float("nan"),
        "<script>",
    ]
    kinds: list[Callable[[], str | bytes]] = [
        lambda: random_numbers.randbytes(random_numbers.randrange(1000)),
        lambda: json.dumps(
            {
                random_numbers.choice(["taken", "select", "back", "stills", "", "a"]): random_numbers.choice(
                    values
                )
            }
        ),
        lambda: json.dumps({"control": random_numbers.choice([v for v in values if v is not None])}),
        lambda: json.dumps(random_numbers.choice(values)),
        lambda: "[" * random_numbers.randrange(1000),
        lambda: "x" * random_numbers.choice([0, 10, 1000]),
        lambda: json.dumps({"taken": 10**6, "select": 0}),
        lambda: json.dumps({"select": random_numbers.randrange(1, 100)}),
    ]
    return random_numbers.choice(kinds)()


def closing_code(page: ClientConnection) -> int:
    """Why the server closed a page's websocket; 1006 without a word."""
    try:
        while True:
            page.recv(10)
    except ConnectionClosed as closed:
        return 1006 if closed.rcvd is None else closed.rcvd.code


def test_hostile_messages_end_their_connection_and_nothing_else(server: Any) -> None:
    """Each is refused with a policy violation; the reasons are logged once; the server goes on."""
    numbers = random.Random(22)
    for _ in range(150):
        message = hostile(numbers)
        if message == '{"stills": true}':  # a page's answer after all
            continue
        with open_page(server.address) as page:
            page.send(message)
            assert closing_code(page) in (1006, 1008, 1009)
    with open_page(server.address) as page:
        page.send("x" * 5000)
        assert closing_code(page) in (1006, 1009)
    assert request(server, "/").status == 200
    lines = [line for line in server.errors.read_text().splitlines() if "refused" in line]
    assert 1 <= sum("page's message" in line for line in lines) <= 4
    assert len(set(lines)) == len(lines)


def test_five_thousand_hostile_messages_are_no_answer() -> None:
    """The reader of a page's messages raises nothing but its own error."""
    numbers = random.Random(5)
    for _ in range(5000):
        message = hostile(numbers)
        try:
            name, value = read_answer(message if isinstance(message, str) else None)
        except InvalidAnswer:
            continue
        assert isinstance(message, str)
        if name == "stills":
            assert type(value) is bool
            continue
        assert name in ("taken", "select", "back")
        assert type(value) is int
        assert value >= 0


@pytest.mark.timeout(120)
def test_a_page_that_reads_nothing_is_cut_off_and_holds_up_no_other(
    serve_keys: Callable[..., str],
    key: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Another page goes on getting packets; the connection of the stuck one is reset."""
    monkeypatch.setattr(hub, "ANSWER_LIMIT_S", 2.0)
    address = "127.0.0.1", urlsplit(serve_keys(key)).port
    launch = (
        "videotestsrc is-live=true pattern=snow ! video/x-raw, width=640, height=480, framerate=25/1 "
        f"! tee name=t ! zenohsink name=z key={key}  t. ! encode gop=25 bitrate=8000 ! z.video"
    )
    stuck = socket.create_connection(address, 10)
    stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    host = "{}:{}".format(*address)
    stuck.sendall(
        f"GET /feed HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
    )
    with Pipeline.parse(launch) as pipeline, open_page(address) as page:
        pipeline.play()
        taken = packets = 0
        while "cut off" not in caplog.text:
            message = page.recv(10)
            taken += 1
            packets += kind_of(message) == "video"
            page.send(json.dumps({"taken": taken}))
        before = packets
        for _ in range(100):
            packets += kind_of(page.recv(10)) == "video"
            taken += 1
            page.send(json.dumps({"taken": taken}))
        assert packets > before > 0
    with pytest.raises(OSError):  # noqa: PT011, PT012
        while stuck.recv(1 << 16):
            pass
        raise ConnectionResetError
    stuck.close()


def test_a_signal_before_the_server_is_up(start_view: Callable[..., Any], key: str) -> None:
    """SIGTERM right after the line with the address ends the process with code 0, which start_view checks."""
    assert start_view(key).process.poll() is None


def test_the_end_of_a_publisher_and_a_missing_one_are_told_apart(
    start_view: Callable[..., Any], key: str
) -> None:
    """Waiting before, ended after."""

    def state(page: ClientConnection, taken: list[int]) -> dict[str, Any]:
        while True:
            message = page.recv(10)
            taken[0] += 1
            page.send(json.dumps({"taken": taken[0]}))
            if isinstance(message, str) and (found := json.loads(message))["type"] == "state":
                return dict(found["body"])

    with open_page(start_view(key).address) as page:
        taken = [0]
        assert state(page, taken)["state"] == "waiting"
        description = f"videotestsrc num-buffers=20 ! zenohsink key={key} wait-subscribers=1"
        Pipeline.parse(description).run(timeout_s=30)
        while (last := state(page, taken))["state"] != "ended":
            assert last["state"] in ("waiting", "playing")
        assert last["received"]["tracks"] == 20
        process = subprocess.Popen(
            [STREAMKIT, "launch", "-q", f"videotestsrc is-live=true ! zenohsink key={key}"],
            stderr=subprocess.DEVNULL,
        )
        while state(page, taken)["state"] != "playing":
            pass
        process.send_signal(signal.SIGKILL)
        process.wait(10)
        while (last := state(page, taken))["state"] != "lost":
            pass
        assert "killed" in last["reason"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("flight.mp4",), "flight.mp4: there is no such file"),
        (("d" * 300 + ".mp4",), "ddd.mp4: there is no such file"),
        (("tracks.jsonl",), "tracks.jsonl: there is no such file"),
        (("uav/1", "--video", "flight.mp4"), "flight.mp4: there is no such file"),
        (("rtsp://a/b", "--video", "/dev/null"), "records and their video go together"),
        (("77",), "/dev/video77: there is no such camera"),
        (("v4l2:///dev/none?framerate=30",), "/dev/none: there is no such camera"),
        (("v4l2:///dev/null?size=9",), "a camera has video_size, framerate, input_format, got size"),
        (("uav/1", "--encode"), "--encode is for the URL of live video"),
        (("LICENSE", "--encode"), "LICENSE: no media that FFmpeg can read"),
        (("uav/1", "--listen", "nonsense"), "--listen must be HOST:PORT"),
        (("uav/1", "--listen", "127.0.0.1:99999"), "--listen must be HOST:PORT"),
        (("uav/1", "--config", "tests"), "zenoh configuration tests: Is a directory"),
        (("http://",), "'http://' names no host; write for example http://camera/video.mjpg"),
        (("http://u:secret@/x",), "'http://***@/x' names no host"),
        (("http://[::1",), "'http://[::1': Invalid IPv6 URL"),
        (("LICENSE",), "LICENSE: no media that FFmpeg can read"),
        (("rstp://a/b",), "'rstp://a/b' must begin with udp:// or tcp://"),
        (("rtsp://u:secret@:1/b",), "rtsp://***@:1/b"),
        (("rtsp://a/b", "uav/1"), "give keys, or one file or URL"),
        (("uav/1", "--basemap", "none.tif"), "--basemap none.tif: No such file"),
        (("tests",), "tests is a folder; give a file, or the key of a zenohsink as tests/tracks"),
        (("u:secret@host/live",), "***@host/live is the address of a server, without its protocol"),
        (("10.0.0.7:554/live",), "10.0.0.7:554/live is the address of a server, without its protocol"),
        (("uav/*",), "a publisher's key must not have wildcards, got 'uav/*'"),
        (("uav/1", "uav/2", "uav/1/tracks"), "uav/1 is given twice"),
        (("uav//1",), "a key must be words joined by single slashes"),
        (("uav/1", "--connect", "127.0.0.1:7447"), "an endpoint must be PROTOCOL/HOST:PORT"),
    ],
)
def test_a_wrong_call_says_why(
    arguments: tuple[str, ...], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one line, with exit code 2, and before a page is announced."""
    monkeypatch.chdir(Path(__file__).parents[3])
    done = CliRunner().invoke(make_app(), ["view", *arguments])
    assert done.exit_code == 2
    assert done.stdout == ""
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_port_in_use_is_reported(server: Any) -> None:
    """With the address and what to do."""
    listen = "{}:{}".format(*server.address)
    done = CliRunner().invoke(make_app(), ["view", "uav/1", "--listen", listen])
    assert done.exit_code == 1
    assert f"--listen {listen}: Address already in use; name another" in done.stderr
