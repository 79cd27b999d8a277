"""Sends a transport stream in real time, again and again, by FFmpeg: sender.py FILE URL."""

import sys
import time
from fractions import Fraction

import av

TICKS = 90_000


def main(path: str, url: str) -> None:
    """Sends until it is killed; timestamps ascend over the repetitions."""
    output = av.open(url, "w", format="mpegts")
    with av.open(path) as source:
        length = round(source.duration * TICKS / 1_000_000) if source.duration else TICKS
        streams = {
            stream.index: output.add_stream_from_template(stream)
            if stream.type == "video"
            else output.add_data_stream("klv")
            for stream in source.streams
        }
    began, offset = time.monotonic(), 0
    while True:
        with av.open(path) as source:
            first = source.start_time * TICKS // 1_000_000
            for packet in source.demux(*(source.streams[index] for index in streams)):
                if packet.dts is None or packet.pts is None:
                    continue
                shift = offset - first
                packet.pts, packet.dts = packet.pts + shift, packet.dts + shift
                packet.stream, packet.time_base = streams[packet.stream_index], Fraction(1, TICKS)
                time.sleep(max(0.0, began + packet.dts / TICKS - time.monotonic()))
                output.mux(packet)
        offset += length


if __name__ == "__main__":
    main(*sys.argv[1:])
