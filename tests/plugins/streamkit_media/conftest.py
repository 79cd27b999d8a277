"""Media made on the spot, and servers that misbehave."""

from __future__ import annotations

import importlib.util
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from fractions import Fraction
from pathlib import Path
from types import ModuleType

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.plugins.streamkit_media.web_server import serving

SYSTEM_PYTHON = "/usr/bin/python3"
RTSP_SERVER = Path(__file__).with_name("rtsp") / "gst_server.py"
HAS_RTSP_SERVER = """
import gi
gi.require_version("GstRtspServer", "1.0")
from gi.repository import Gst, GstRtspServer
Gst.init(None)
assert Gst.ElementFactory.find("x264enc") and Gst.ElementFactory.find("rtph264pay")
"""
MakeVideo = Callable[..., Path]


def grey_ramp(width: int, height: int, index: int) -> NDArray[np.uint8]:
    """uint8[h * 3 // 2, w] in I420: a diagonal ramp that moves with the frame's number."""
    rows, columns = np.mgrid[:height, :width]
    pixels = np.full((height * 3 // 2, width), 128, np.uint8)
    pixels[:height] = 40 + (rows + columns + 4 * index) % 160
    return pixels


@pytest.fixture(scope="session")
def make_video(tmp_path_factory: pytest.TempPathFactory) -> MakeVideo:
    """Makes a video; name, count, size, rate, codec, bframes, pixel_format, (container_)options."""
    folder = tmp_path_factory.mktemp("media")

    def make(
        name: str,
        count: int = 12,
        size: tuple[int, int] = (64, 48),
        rate: Fraction = Fraction(25),
        codec: str = "libx264",
        bframes: int = 2,
        pixel_format: str = "yuv420p",
        options: Mapping[str, str] | None = None,
        container_options: Mapping[str, str] | None = None,
    ) -> Path:
        path = folder / name
        if options is None:
            options = {"g": "6"} if codec == "libx264" else {}
        options = {"bf": str(bframes), **options} if codec == "libx264" else options
        with av.open(str(path), "w", options=dict(container_options or {})) as container:
            stream = container.add_stream(codec, rate=rate, options=options)
            stream.width, stream.height = size
            stream.pix_fmt = pixel_format
            for index in range(count):
                video_frame = av.VideoFrame.from_ndarray(grey_ramp(*size, index), "yuv420p")
                video_frame = video_frame.reformat(format=pixel_format)
                video_frame.pts, video_frame.time_base = index, 1 / rate
                container.mux(stream.encode(video_frame))
            container.mux(stream.encode(None))
        return path

    return make


@pytest.fixture(scope="session")
def small_video(make_video: MakeVideo) -> Path:
    """12 frames of 64 x 48 at 25/s, H.264 with B-frames and a keyframe every 6."""
    return make_video("small.mp4")


@pytest.fixture
def serve() -> Iterator[Callable[[int], int]]:
    """Starts a TCP server that answers the first n RTSP requests with 200 OK and is silent then; its port."""
    with ExitStack() as stack:

        def start(answers: int) -> int:
            listener = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
            listener.settimeout(0.05)
            done = threading.Event()
            thread = threading.Thread(target=_answer, args=(listener, answers, done))
            thread.start()
            stack.callback(thread.join, 5.0)
            stack.callback(done.set)
            return int(listener.getsockname()[1])

        yield start


def _answer(listener: socket.socket, answers: int, done: threading.Event) -> None:
    with ExitStack() as stack:
        connections: list[tuple[socket.socket, list[int]]] = []
        while not done.is_set():
            try:
                connection = stack.enter_context(listener.accept()[0])
                connection.settimeout(0.05)
                connections.append((connection, [answers]))
            except TimeoutError:
                pass
            for connection, left in connections:
                _answer_one(connection, left)


def _answer_one(connection: socket.socket, left: list[int]) -> None:
    try:
        request = connection.recv(4096).decode()
    except OSError:
        return
    if request and left[0] > 0:
        left[0] -= 1
        number = next(line for line in request.split("\r\n") if line.startswith("CSeq"))
        reply = f"RTSP/1.0 200 OK\r\n{number}\r\nPublic: OPTIONS, DESCRIBE, SETUP, PLAY\r\n\r\n"
        connection.sendall(reply.encode())


def load(file: str) -> ModuleType:
    """A module beside the tests of RTSP."""
    name = f"streamkit_media_{Path(file).stem}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name("rtsp") / file)
        assert spec is not None
        assert spec.loader is not None
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return sys.modules[name]


@pytest.fixture(scope="session")
def fake() -> ModuleType:
    """The module of the server: `FakeServer`, `Behaviour`, `access_units`."""
    return load("fake_server.py")


@pytest.fixture(scope="session")
def proxy() -> ModuleType:
    """The module of the bad network: `LossyProxy`."""
    return load("lossy_proxy.py")


@pytest.fixture(scope="session")
def units(fake: ModuleType) -> list[bytes]:
    """60 frames of 64 x 48; frame i is of brightness 40 + 2 * i, every 15th a keyframe."""
    return fake.access_units()


class RealServer:
    """A gst-rtsp-server in a process of its own, with user "user" and password "secret"."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [SYSTEM_PYTHON, str(RTSP_SERVER)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        assert self.process.stdout is not None
        self.port = int(self.process.stdout.readline())

    def close(self) -> None:
        """Kills the server, as a drone that is switched off."""
        self.process.kill()
        self.process.wait(10)
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture
def real_server() -> Iterator[RealServer]:
    """A real RTSP server with a live H.264 stream of 320 x 240 at 30/s."""
    if not Path(SYSTEM_PYTHON).exists():
        pytest.skip("no system Python: the RTSP server of these tests runs in it")
    probe = subprocess.run(
        [SYSTEM_PYTHON, "-c", HAS_RTSP_SERVER], capture_output=True, timeout=30, check=False
    )
    if probe.returncode:
        pytest.skip(
            "no gst-rtsp-server: install gir1.2-gst-rtsp-server-1.0 gstreamer1.0-plugins-good "
            "gstreamer1.0-plugins-bad gstreamer1.0-plugins-ugly python3-gi"
        )
    server = RealServer()
    yield server
    server.close()


def local_set(latitude: float | None, time_us: int = 0) -> bytes:
    """A UAS local set with time, latitude and longitude 0, or with the time alone, and a good checksum."""
    value = b"\x02\x08" + time_us.to_bytes(8, "big")
    if latitude is not None:
        number = round(latitude / 90 * (2**31 - 1))
        value += b"\x0d\x04" + number.to_bytes(4, "big", signed=True) + b"\x0e\x04" + bytes(4)
    data = bytes.fromhex("060e2b34020b01010e01030101000000") + bytes([len(value) + 4]) + value + b"\x01\x02"
    return data + ((sum(data[0::2]) * 256 + sum(data[1::2])) & 0xFFFF).to_bytes(2, "big")


@pytest.fixture(scope="session")
def klv_packet() -> Callable[..., bytes]:
    """Makes a KLV packet; arguments: latitude (None for none), time_us."""
    return local_set


@pytest.fixture(scope="session")
def two_klv_streams(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """12 frames at 25/s in a transport stream; times in the first KLV stream, positions in the second."""
    path = tmp_path_factory.mktemp("media") / "two.ts"
    with av.open(str(path), "w", format="mpegts") as container:
        video = container.add_stream("libx264", rate=Fraction(25), options={"bf": "0"})
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        data = [container.add_data_stream("klv"), container.add_data_stream("klv")]
        for index in range(12):
            video_frame = av.VideoFrame.from_ndarray(grey_ramp(64, 48, index), "yuv420p")
            video_frame.pts, video_frame.time_base = index, Fraction(1, 25)
            container.mux(video.encode(video_frame))
            for stream, latitude in zip(data, (None, 10.0 + index), strict=True):
                packet = av.Packet(local_set(latitude, 10**15 + 40_000 * index))
                packet.stream, packet.time_base = stream, Fraction(1, 90_000)
                packet.pts = packet.dts = index * 3600
                container.mux(packet)
        container.mux(video.encode(None))
    return path


@pytest.fixture(scope="session")
def clip(tmp_path_factory: pytest.TempPathFactory, klv_packet: Callable[..., bytes]) -> Path:
    """100 frames of 64 x 48 at 25/s, a keyframe every 10, each with a position in two KLV streams."""
    path = tmp_path_factory.mktemp("live") / "clip.ts"
    options = {"bf": "0", "g": "10", "tune": "zerolatency"}
    with av.open(str(path), "w", format="mpegts") as container:
        video = container.add_stream("libx264", rate=Fraction(25), options=options)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        telemetry = [container.add_data_stream("klv"), container.add_data_stream("klv")]
        for index in range(100):
            pixels = np.full((72, 64), 128, np.uint8)
            pixels[:48] = 40 + index
            frame = av.VideoFrame.from_ndarray(pixels, "yuv420p")
            frame.pts, frame.time_base = index, Fraction(1, 25)
            container.mux(video.encode(frame))
            for number, stream in enumerate(telemetry):
                packet = av.Packet(klv_packet(10.0 * (number + 1), 10**15 + 40_000 * index))
                packet.stream, packet.time_base = stream, Fraction(1, 90_000)
                packet.pts = packet.dts = index * 3600
                container.mux(packet)
        container.mux(video.encode(None))
    return path


@pytest.fixture
def serve_folder(tmp_path: Path) -> Iterator[str]:
    """A server of the test's folder; its address."""
    with serving(tmp_path) as address:
        yield address


@pytest.fixture
def port() -> int:
    """A port that is free for UDP and TCP."""
    while True:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagrams,
            socket.create_server(("", 0)) as server,
            suppress(OSError),  # something of this machine uses it for UDP
        ):
            free = int(server.getsockname()[1])
            datagrams.bind(("", free))
            return free
