"""A server of RTMP that plays a file to one client: rtmp_server.py FILE PORT.

Source: Adobe's Real Time Messaging Protocol, sections 5 and 7; FLV's tags carry the same payloads.
"""

import io
import socket
import struct
import sys
import time

import av

HANDSHAKE = 1536
CHUNK = 128
COMMAND, VIDEO = 20, 9


def text(value: str) -> bytes:
    """A text in AMF0."""
    return b"\x02" + struct.pack(">H", len(value)) + value.encode()


def number(value: float) -> bytes:
    """A number in AMF0."""
    return b"\x00" + struct.pack(">d", value)


def message(kind: int, payload: bytes, time_ms: int = 0) -> bytes:
    """A message of stream 1 in chunks."""
    head = (
        b"\x04" + time_ms.to_bytes(3) + len(payload).to_bytes(3) + bytes([kind]) + (1).to_bytes(4, "little")
    )
    pieces = [payload[at : at + CHUNK] for at in range(0, len(payload), CHUNK)]
    return head + b"\xc4".join(pieces)


def tags(path: str) -> list[tuple[int, bytes]]:
    """Times, ms, and payloads of the file's video as FLV has it."""
    buffer = io.BytesIO()
    with av.open(path) as source, av.open(buffer, "w", format="flv") as output:
        video = source.streams.video[0]
        copy = output.add_stream_from_template(video)
        for packet in source.demux(video):
            if packet.dts is not None:
                packet.stream = copy
                output.mux(packet)
    data, at, found = buffer.getvalue(), 13, []
    while at < len(data):
        size = int.from_bytes(data[at + 1 : at + 4])
        if data[at] == VIDEO:
            found.append((int.from_bytes(data[at + 4 : at + 7]), data[at + 11 : at + 11 + size]))
        at += 11 + size + 4
    return found


def play(connection: socket.socket, video: list[tuple[int, bytes]]) -> None:
    """Answers what a player asks, then sends the video in real time."""
    received = b""
    while len(received) < 1 + HANDSHAKE:
        received += connection.recv(4096)
    connection.sendall(b"\x03" + bytes(HANDSHAKE) + received[1 : 1 + HANDSHAKE])
    received = b""
    answered: set[bytes] = set()
    while b"play" not in answered:
        received += connection.recv(4096)
        for name in (b"connect", b"createStream", b"play"):
            at = received.find(b"\x02" + struct.pack(">H", len(name)) + name)
            if at < 0 or name in answered:
                continue
            answered.add(name)
            (call,) = struct.unpack(">d", received[at + 4 + len(name) : at + 12 + len(name)])
            if name == b"play":
                status = b"\x03" + text("code")[1:] + text("NetStream.Play.Start") + b"\x00\x00\x09"
                connection.sendall(message(COMMAND, text("onStatus") + number(0) + b"\x05" + status))
            else:
                connection.sendall(message(COMMAND, text("_result") + number(call) + b"\x05" + number(1)))
    began = time.monotonic()
    for time_ms, payload in video:
        time.sleep(max(0.0, began + time_ms / 1000 - time.monotonic()))
        connection.sendall(message(VIDEO, payload, time_ms))
    connection.recv(1)


def main(path: str, port: str) -> None:
    """Plays to one client after another."""
    video = tags(path)
    with socket.create_server(("127.0.0.1", int(port))) as server:
        while True:
            with server.accept()[0] as connection:
                try:
                    play(connection, video)
                except OSError:
                    continue


if __name__ == "__main__":
    main(*sys.argv[1:])
