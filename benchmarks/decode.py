"""Decoding 1080p H.264: to grey against ffmpeg and GStreamer, to BGR against cv2.VideoCapture.

Run it:  STREAMKIT_DATA=... python benchmarks/decode.py [FILE [ROUNDS [THREADS]]]
"""

from __future__ import annotations

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2

from streamkit import Pipeline

ROUNDS = 5
LOOPS = 4
LIMIT_S = 300.0


def looped(source: Path, target: Path) -> int:
    """Writes a file's packets several times over, so that start-up does not count; the number of frames."""
    count = 0
    with av.open(str(target), "w", format="mpegts") as out:
        stream = None
        for loop in range(LOOPS):
            with av.open(str(source)) as container:
                video = container.streams.video[0]
                stream = stream or out.add_stream_from_template(video)
                length = round(video.frames / Fraction(video.average_rate or 25) / video.time_base)
                for packet in container.demux(video):
                    if packet.size and packet.pts is not None and packet.dts is not None:
                        packet.pts, packet.dts = packet.pts + loop * length, packet.dts + loop * length
                        packet.stream = stream
                        out.mux(packet)
                        count += 1
    return count


def ours(path: Path, wanted: str, threads: int) -> float:
    """Seconds for our pipeline."""
    source = f"filesrc location={path} ! decode threads={threads}"
    pipeline = Pipeline.parse(f"{source} ! video/x-raw,format={wanted} ! fakesink")
    began = time.perf_counter()
    pipeline.run(timeout_s=LIMIT_S)
    return time.perf_counter() - began


def command(words: list[str]) -> float:
    """Seconds for a command."""
    began = time.perf_counter()
    subprocess.run(words, check=True, capture_output=True, timeout=LIMIT_S)
    return time.perf_counter() - began


def opencv(path: Path) -> float:
    """Seconds for cv2.VideoCapture to BGR."""
    began = time.perf_counter()
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    while capture.read()[0]:
        continue
    capture.release()
    return time.perf_counter() - began


def main() -> None:
    """Runs all in turn and prints medians of frames per second, and ratios of the rounds' pairs."""
    default = Path(os.environ.get("STREAMKIT_DATA", "")) / "data" / "video" / "drone_nadir_traffic.mp4"
    source = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else ROUNDS
    threads = int(sys.argv[3]) if len(sys.argv) > 3 else 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "looped.ts"
        frames = looped(source, path)
        runs: dict[str, Callable[[], float]] = {"ours to grey": lambda: ours(path, "GRAY8", threads)}
        if shutil.which("ffmpeg"):
            words = ["ffmpeg", "-v", "error", "-i", str(path), "-an", "-f", "null", "-"]
            runs["ffmpeg, no conversion"] = lambda: command(words)
        if shutil.which("gst-launch-1.0"):
            chain = f"filesrc location={path} ! tsdemux ! h264parse ! avdec_h264 ! videoconvert"
            text = f"{chain} ! video/x-raw,format=GRAY8 ! fakesink sync=false"
            runs["GStreamer to grey"] = lambda: command(["gst-launch-1.0", "-q", *text.split()])
        runs["ours to BGR"] = lambda: ours(path, "BGR", threads)
        runs["cv2 to BGR"] = lambda: opencv(path)
        times: dict[str, list[float]] = {name: [] for name in runs}
        for _ in range(rounds):
            for name, run in runs.items():
                times[name].append(run())
    for name, taken in times.items():
        print(f"{name:24} {frames / statistics.median(taken):8.1f} frames/s")
    for mine, peer in (
        ("ours to grey", "ffmpeg, no conversion"),
        ("ours to grey", "GStreamer to grey"),
        ("ours to BGR", "cv2 to BGR"),
    ):
        if peer in times:
            ratio = statistics.median(b / a for a, b in zip(times[mine], times[peer], strict=True))
            print(f"{mine} / {peer}: {ratio:.2f}")


if __name__ == "__main__":
    main()
