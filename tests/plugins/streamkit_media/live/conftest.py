"""Senders of live video: processes of FFmpeg and GStreamer, and a thread that sends datagrams."""

import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import urlsplit

import pytest

SENDER, RTMP_SERVER = (Path(__file__).with_name(name) for name in ("sender.py", "rtmp_server.py"))
DATAGRAM = 7 * 188
Start = Callable[..., subprocess.Popen[bytes]]


def kill(process: subprocess.Popen[bytes]) -> None:
    """Kills a sender, as a drone that is switched off."""
    process.kill()
    process.wait(10)


@pytest.fixture
def start_ffmpeg(clip: Path) -> Iterator[Start]:
    """Starts a process that sends the clip; its argument is a URL of udp, of tcp or of rtmp to serve at."""
    with ExitStack() as stack:

        def start(url: str) -> subprocess.Popen[bytes]:
            parts = urlsplit(url)
            command = [str(SENDER), str(clip), f"{url}?listen=1" if parts.scheme == "tcp" else url]
            if parts.scheme == "rtmp":
                command = [str(RTMP_SERVER), str(clip), str(parts.port)]
            process = subprocess.Popen([sys.executable, *command], stderr=subprocess.DEVNULL)
            stack.callback(kill, process)
            return process

        yield start


@pytest.fixture
def start_gstreamer() -> Iterator[Start]:
    """Starts a process that sends 320 x 240 at 30/s by GStreamer; arguments: its muxer, its sink."""
    if shutil.which("gst-launch-1.0") is None:
        pytest.skip("no GStreamer: install gstreamer1.0-tools and the plugins good, bad and ugly")
    with ExitStack() as stack:

        def start(muxer: str, sink: str) -> subprocess.Popen[bytes]:
            text = (
                "videotestsrc is-live=true ! video/x-raw,width=320,height=240,framerate=30/1 ! "
                f"x264enc tune=zerolatency key-int-max=15 ! {muxer} ! {sink}"
            )
            process = subprocess.Popen(["gst-launch-1.0", "-q", *text.split()], stderr=subprocess.DEVNULL)
            stack.callback(kill, process)
            return process

        yield start


def rtp_packet(payload: bytes, number: int, source: int = 7) -> bytes:
    """A packet of RTP with a transport stream."""
    return b"\x80\x21" + (number % 65536).to_bytes(2) + bytes(4) + source.to_bytes(4) + payload


@pytest.fixture(scope="session")
def as_rtp() -> Callable[..., bytes]:
    """Makes a packet of RTP; arguments: payload, number, source."""
    return rtp_packet


def is_received(port: int) -> bool:
    """Whether a socket of this machine receives datagrams at a port."""
    tables = (Path("/proc/net") / name for name in ("udp", "udp6"))
    lines = [line for table in tables for line in table.read_text().splitlines()[1:]]
    return any(line.split()[1].endswith(f":{port:04X}") for line in lines)


class DatagramSender:
    """Sends datagrams in a thread, evenly over a duration, as soon as somebody receives.

    Args:
        target: address and port.
        datagrams: to send, in this order.
        seconds: for all of them.
    """

    def __init__(self, target: tuple[str, int], datagrams: list[bytes], seconds: float) -> None:
        self._target, self._datagrams, self._seconds = target, datagrams, seconds
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._send)
        self._thread.start()

    def stop(self) -> None:
        """Ends sending."""
        self._done.set()
        self._thread.join(10)

    def wait(self) -> None:
        """Waits until everything is sent."""
        self._thread.join(30)

    def _send(self) -> None:
        while not is_received(self._target[1]):
            if self._done.wait(0.005):
                return
        family = socket.AF_INET6 if ":" in self._target[0] else socket.AF_INET
        with socket.socket(family, socket.SOCK_DGRAM) as sender:
            if family == socket.AF_INET:
                sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
            pause_s = self._seconds / len(self._datagrams)
            for datagram in self._datagrams:
                if self._done.wait(pause_s):
                    return
                sender.sendto(datagram, self._target)


@pytest.fixture
def send() -> Iterator[Callable[..., DatagramSender]]:
    """Starts a thread that sends; arguments of `DatagramSender`."""
    with ExitStack() as stack:

        def start(target: tuple[str, int], datagrams: list[bytes], seconds: float) -> DatagramSender:
            sender = DatagramSender(target, datagrams, seconds)
            stack.callback(sender.stop)
            return sender

        yield start


@pytest.fixture(scope="session")
def datagrams(clip: Path) -> list[bytes]:
    """The clip in datagrams of seven transport packets."""
    data = clip.read_bytes()
    return [data[at : at + DATAGRAM] for at in range(0, len(data), DATAGRAM)]
