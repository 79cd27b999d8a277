"""A small RTSP server for tests: plays H.264 in real time, or misbehaves in a chosen way."""

from __future__ import annotations

import base64
import enum
import random
import re
import socket
import struct
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction

import av
import numpy as np

CLOCK = 90_000
NTP_EPOCH_S = 2_208_988_800
PAYLOAD_LIMIT = 1200
POLL_S = 0.02
METHODS = "OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN, GET_PARAMETER"


TELEMETRY_SDP = (
    "m=application 0 RTP/AVP 97\r\nc=IN IP4 0.0.0.0\r\na=rtpmap:97 smpte336m/90000\r\na=control:telemetry\r\n"
)


SDP_HEAD = (
    "v=0\r\no=- 1 1 IN IP4 127.0.0.1\r\ns=drone\r\nt=0 0\r\nm=video 0 RTP/AVP 96\r\nc=IN IP4 0.0.0.0\r\n"
)


class Behaviour(enum.StrEnum):
    """What the server does with a client."""

    PLAY = "play"
    SILENT = "accept and never answer"
    DESCRIBE_ONLY = "answer DESCRIBE, then be silent"
    NO_MEDIA = "answer PLAY, then send nothing"
    HALF_FRAME = "send ten frames and half of another, then nothing"
    GARBAGE = "answer with random bytes"
    NO_TCP = "refuse to send over TCP"
    REDIRECT = "redirect to itself for ever"
    CLOSE = "accept, then close"
    CLOSE_AFTER = "send ten frames, then close"
    BYE = "send ten frames, then say good-bye over RTCP and stay connected"


def access_units(
    size: tuple[int, int] = (64, 48), count: int = 60, gop: int = 15, codec: str = "libx264", **options: str
) -> list[bytes]:
    """H.264 access units; frame i is of brightness 40 + 2 * i, which identifies it."""
    encoder = av.CodecContext.create(codec, "w")
    encoder.width, encoder.height, encoder.pix_fmt = *size, "yuv420p"
    encoder.time_base, encoder.framerate = Fraction(1, 30), Fraction(30)
    encoder.options = {"tune": "zerolatency", "preset": "ultrafast", "g": str(gop), "bf": "0", **options}
    if codec == "libx265":
        encoder.options |= {"x265-params": f"keyint={gop}:log-level=none:repeat-headers=1"}
    units = []
    for index in range(count):
        pixels = np.full((size[1] * 3 // 2, size[0]), 128, np.uint8)
        pixels[: size[1]] = 40 + 2 * index
        video_frame = av.VideoFrame.from_ndarray(pixels, "yuv420p")
        video_frame.pts = index
        units += [bytes(packet) for packet in encoder.encode(video_frame)]
    return units + [bytes(packet) for packet in encoder.encode(None)]


def nal_units(unit: bytes) -> list[bytes]:
    """The NAL units of an access unit in Annex B form."""
    return [part for part in re.split(b"\0\0\0?\1", unit) if part]


def rtp_payloads(unit: bytes, codec: str = "h264") -> Iterator[bytes]:
    """The RTP payloads of an access unit: single NAL units and fragments (RFC 6184, RFC 7798)."""
    is_h265 = codec == "h265"
    for nal in nal_units(unit):
        if len(nal) <= PAYLOAD_LIMIT:
            yield nal
            continue
        if is_h265:
            indicator, kind, body = bytes([nal[0] & 0x81 | 49 << 1, nal[1]]), nal[0] >> 1 & 0x3F, nal[2:]
        else:
            indicator, kind, body = bytes([nal[0] & 0xE0 | 28]), nal[0] & 0x1F, nal[1:]
        pieces = [body[start : start + PAYLOAD_LIMIT] for start in range(0, len(body), PAYLOAD_LIMIT)]
        for index, piece in enumerate(pieces):
            mark = (0x80 if index == 0 else 0) | (0x40 if index == len(pieces) - 1 else 0)
            yield indicator + bytes([mark | kind]) + piece


@dataclass
class FakeServer:
    """Serves rtsp://127.0.0.1:PORT/live until closed; one thread accepts, one serves each client.

    Attributes:
        units: what it plays, again and again.
        behaviour: may be changed at any time; holds for clients that come later.
        rate: frames per second.
        user: "name:password" it asks for, or "".
        wall_clock_offset_s: added to the wall clock that the sender reports tell.
        telemetry: KLV packets sent beside the video_frames, one with each, again and again; none where empty.
        loses_every: of so many RTP packets of the video one is not sent; 0 loses none.
        codec: of the units, h264 or h265.
        stands_still: give every frame the same RTP time stamp.
        connections: clients accepted so far.
        frames_sent: over all clients.
    """

    units: Sequence[bytes]
    behaviour: Behaviour = Behaviour.PLAY
    port: int = 0
    rate: float = 30.0
    user: str = ""
    wall_clock_offset_s: float = 0.0
    telemetry: Sequence[bytes] = ()
    loses_every: int = 0
    codec: str = "h264"
    stands_still: bool = False
    connections: int = 0
    frames_sent: int = 0
    _closing: threading.Event = field(default_factory=threading.Event)
    _threads: list[threading.Thread] = field(default_factory=list)

    def __enter__(self) -> FakeServer:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def url(self) -> str:
        """Where it serves."""
        return f"rtsp://127.0.0.1:{self.port}/live"

    def open(self) -> None:
        """Listens, on the same port as before where it has listened before."""
        self._closing.clear()
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self.port = self._listener.getsockname()[1]
        self._listener.settimeout(POLL_S)
        self._start(self._accept, self._listener)

    def close(self) -> None:
        """Drops every client, as a drone that is switched off."""
        self._closing.set()
        for thread in self._threads:
            thread.join(10)
        self._threads.clear()

    def _start(self, target: object, *arguments: object) -> None:
        thread = threading.Thread(target=target, args=arguments)  # type: ignore[arg-type]
        self._threads = [other for other in self._threads if other.is_alive()] + [thread]
        thread.start()

    def _accept(self, listener: socket.socket) -> None:
        with listener:
            while not self._closing.is_set():
                with suppress(TimeoutError):
                    connection, _ = listener.accept()
                    self.connections += 1
                    self._start(self._serve, connection, self.behaviour)

    def _serve(self, connection: socket.socket, behaviour: Behaviour) -> None:
        with connection:
            connection.settimeout(POLL_S)
            with suppress(OSError):
                Client(self, connection, behaviour, self._closing).serve()


class Client:
    """One client's session."""

    def __init__(
        self, server: FakeServer, connection: socket.socket, behaviour: Behaviour, closing: threading.Event
    ) -> None:
        self.server, self.connection, self.behaviour, self.closing = server, connection, behaviour, closing
        self.buffer = b""
        self.udp: tuple[socket.socket, int] | None = None
        self.number = random.randrange(1 << 16)
        self.first_stamp = random.randrange(1 << 32)
        self.playing = False

    def serve(self) -> None:
        """Answers requests; plays once asked to."""
        if self.behaviour is Behaviour.CLOSE:
            return
        while not self.closing.is_set() and not self.playing:
            request = self.request()
            if request is None:
                return
            if request:
                self.answer(request)
        try:
            if self.playing:
                self.play()
        finally:
            if self.udp is not None:
                self.udp[0].close()

    def request(self) -> str | None:
        """The next request; "" while there is none, None when the client has gone."""
        try:
            data = self.connection.recv(4096)
        except TimeoutError:
            return ""
        if not data:
            return None
        self.buffer += data
        while self.buffer[:1] == b"$" and len(self.buffer) >= 4:
            self.buffer = self.buffer[4 + int.from_bytes(self.buffer[2:4], "big") :]
        head, mark, rest = self.buffer.partition(b"\r\n\r\n")
        if not mark:
            return ""
        self.buffer = rest
        return head.decode()

    def answer(self, request: str) -> None:
        """Answers one request, or not, as the behaviour has it."""
        method = request.split(" ", 1)[0]
        if self.behaviour is Behaviour.SILENT:
            return
        if self.behaviour is Behaviour.GARBAGE:
            self.connection.sendall(random.randbytes(2000))
            return
        if self.behaviour is Behaviour.DESCRIBE_ONLY and method not in ("OPTIONS", "DESCRIBE"):
            return
        if self.behaviour is Behaviour.REDIRECT:
            self.reply(request, "302 Found", f"Location: {self.server.url}\r\n")
        elif self.server.user and not self.is_allowed(request):
            self.reply(request, "401 Unauthorized", 'WWW-Authenticate: Basic realm="drone"\r\n')
        elif method == "DESCRIBE":
            self.reply(request, "200 OK", "Content-Type: application/sdp\r\n", self.description())
        elif method == "SETUP" and self.behaviour is Behaviour.NO_TCP and "interleaved" in request:
            self.reply(request, "461 Unsupported Transport", "")
        elif method == "SETUP":
            self.reply(request, "200 OK", f"Transport: {self.transport(request)}\r\n")
        else:
            self.reply(request, "200 OK", f"Public: {METHODS}\r\nRange: npt=0-\r\n")
            self.playing = method == "PLAY"

    def is_allowed(self, request: str) -> bool:
        """Whether the request carries the right name and password."""
        return f"Basic {base64.b64encode(self.server.user.encode()).decode()}" in request

    def reply(self, request: str, status: str, fields: str, body: str = "") -> None:
        """Sends a response."""
        number = re.search(r"(?i)CSeq: *(\d+)", request)
        length = f"Content-Length: {len(body)}\r\n" if body else ""
        text = (
            f"RTSP/1.0 {status}\r\nCSeq: {number and number[1]}\r\nSession: 7;timeout=60\r\n{fields}{length}"
        )
        self.connection.sendall(f"{text}\r\n{body}".encode())

    def description(self) -> str:
        """The SDP."""
        if self.server.codec == "h265":
            return f"{SDP_HEAD}a=rtpmap:96 H265/90000\r\na=control:video\r\n"
        first = nal_units(self.server.units[0])
        sets = ",".join(base64.b64encode(nal).decode() for nal in first if nal[0] & 31 in (7, 8))
        return (
            f"{SDP_HEAD}a=rtpmap:96 H264/90000\r\n"
            f"a=fmtp:96 packetization-mode=1;sprop-parameter-sets={sets}\r\na=control:video\r\n"
        ) + (TELEMETRY_SDP if self.server.telemetry else "")

    def transport(self, request: str) -> str:
        """The Transport field of the answer to SETUP."""
        ports = re.search(r"client_port=(\d+)", request)
        channels = re.search(r"interleaved=(\d+-\d+)", request)
        if ports is None:
            return f"RTP/AVP/TCP;unicast;interleaved={channels and channels[1]}"
        sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sender.bind(("127.0.0.1", 0))
        self.udp = (sender, int(ports[1]))
        own = sender.getsockname()[1]
        return f"RTP/AVP;unicast;client_port={ports[1]}-{int(ports[1]) + 1};server_port={own}-{own + 1}"

    def send(self, channel: int, data: bytes) -> None:
        """Sends one RTP (channel 0) or RTCP (1) packet."""
        if self.udp is None:
            self.connection.sendall(struct.pack(">cBH", b"$", channel, len(data)) + data)
        else:
            self.udp[0].sendto(data, ("127.0.0.1", self.udp[1] + channel))

    def report(self, frames: int, began_utc_s: float) -> bytes:
        """A sender report that ties the stamp of frame number `frames` to the wall clock."""
        moment = began_utc_s + frames / self.server.rate + NTP_EPOCH_S
        ntp = int(moment) << 32 | int(moment % 1 * (1 << 32))
        return struct.pack(">BBHIQIII", 0x80, 200, 6, 7, ntp, self.stamp(frames), frames, 0)

    def stamp(self, frames: int) -> int:
        """The RTP time stamp of a frame."""
        ticks = 0 if self.server.stands_still else round(frames * CLOCK / self.server.rate)
        return (self.first_stamp + ticks) & 0xFFFFFFFF

    def play(self) -> None:
        """Sends frames in real time."""
        if self.behaviour is Behaviour.NO_MEDIA:
            self.wait_for_client_or_close()
            return
        began, began_utc = time.monotonic(), time.time() + self.server.wall_clock_offset_s
        frames = 0
        while not self.closing.wait(max(0.0, began + frames / self.server.rate - time.monotonic())):
            if frames == 10 and self.behaviour is not Behaviour.PLAY:
                self.leave(frames)
                return
            if frames % 15 == 0:
                self.send(1, self.report(frames, began_utc))
            self.send_frame(frames, self.payloads(frames))
            self.send_telemetry(frames)
            frames += 1
            self.server.frames_sent += 1

    def payloads(self, frames: int) -> list[bytes]:
        """The RTP payloads of a frame."""
        return list(rtp_payloads(self.server.units[frames % len(self.server.units)], self.server.codec))

    def send_frame(self, frames: int, payloads: list[bytes]) -> None:
        """Sends one frame's packets."""
        for index, payload in enumerate(payloads):
            mark = 0x80 if index == len(payloads) - 1 else 0
            head = struct.pack(">BBHII", 0x80, mark | 96, self.number, self.stamp(frames), 7)
            self.number = (self.number + 1) & 0xFFFF
            if not self.server.loses_every or self.number % self.server.loses_every:
                self.send(0, head + payload)

    def send_telemetry(self, frames: int) -> None:
        """Sends the KLV packet of a frame, over TCP only (RFC 6597)."""
        if self.server.telemetry and self.udp is None:
            data = self.server.telemetry[frames % len(self.server.telemetry)]
            self.send(
                2, struct.pack(">BBHII", 0x80, 0x80 | 97, frames & 0xFFFF, self.stamp(frames), 9) + data
            )

    def leave(self, frames: int) -> None:
        """After ten frames: half a frame, a good-bye, or the end of the connection."""
        if self.behaviour is Behaviour.HALF_FRAME:
            payload = max(self.server.units, key=len)[:PAYLOAD_LIMIT]
            head = struct.pack(">BBHII", 0x80, 96, self.number, self.stamp(frames), 7)
            data = struct.pack(">cBH", b"$", 0, len(head) + len(payload)) + head + payload
            self.connection.sendall(data[: len(data) // 2])
        if self.behaviour is Behaviour.BYE:
            self.send(1, self.report(frames, time.time()) + struct.pack(">BBHI", 0x81, 203, 1, 7))
        if self.behaviour is not Behaviour.CLOSE_AFTER:
            self.wait_for_client_or_close()

    def wait_for_client_or_close(self) -> None:
        """Stays connected until either side ends."""
        while not self.closing.is_set() and self.request() is not None:
            continue


def main() -> None:
    """Serves alone until its input is closed; prints the port. Arguments: width height rate."""
    import sys

    width, height, rate = (int(word) for word in sys.argv[1:4])
    with FakeServer(access_units((width, height)), rate=rate) as server:
        print(server.port, flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main()
