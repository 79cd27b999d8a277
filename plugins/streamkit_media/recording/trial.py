"""Writes one H.265 packet from stdin as Matroska to nowhere: a process of its own, that can be given up."""

from __future__ import annotations

import io
import sys

import av
from av.packet import Packet


def main() -> None:
    """Ends with an exception, and so with another exit code than 0, where the muxer refuses the packet."""
    with av.open(io.BytesIO(), "w", format="matroska") as container:
        packet = Packet(sys.stdin.buffer.read())
        packet.stream = container.add_mux_stream("hevc", width=16, height=16)
        packet.pts = packet.dts = 0
        packet.is_keyframe = True
        container.mux_one(packet)


if __name__ == "__main__":
    main()
