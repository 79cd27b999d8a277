"""Age of live 1080p30 frames at the sink, through RTSP on this machine.

The server sends a wall clock in its sender reports: a frame's age is now less its capture time.
Second part: a consumer that takes 200 ms a frame; its frames' ages, and whether all frames are accounted for.

Run it:  python benchmarks/rtsp_age.py [SECONDS [SLOW_SECONDS]]
"""

from __future__ import annotations

import statistics
import sys
import time

from rtsp_peer import server_process

from streamkit import Pipeline

SECONDS = 20.0
SLOW_SECONDS = 60.0
SETTLE = 30
RATE = 30


def summary(name: str, ages_ms: list[float]) -> str:
    """Median and 99th percentile."""
    ordered = sorted(ages_ms)
    high = ordered[min(len(ordered) - 1, round(0.99 * len(ordered)))]
    return (
        f"{name}: {len(ages_ms)} frames, age median {statistics.median(ages_ms):.1f} ms, 99 % {high:.1f} ms"
    )


def live_ages_ms(url: str, seconds: float, transport: str) -> list[float]:
    """Capture-to-sink age of each frame, ms."""
    ages = []
    text = f"rtspsrc location={url} transport={transport} ! decode ! appsink name=out drop=true max-buffers=1"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            frame = pipeline["out"].pull(10)
            if frame is not None and frame.capture is not None and frame.capture.origin == "rtcp":
                ages.append((time.time_ns() - frame.capture.utc_ns) / 1e6)
    return ages[SETTLE:]


def slow_consumer(url: str, seconds: float) -> str:
    """Ages with 200 ms of work on each frame, and the count of all."""
    source = f"rtspsrc name=r location={url} reconnect=never"
    text = f"{source} ! decode name=d ! identity sleep-time=200000 ! appsink name=out max-buffers=0"
    ages = []
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            frame = pipeline["out"].pull(10)
            if frame is not None:
                ages.append((time.monotonic_ns() - frame.arrival_ns) / 1e6)
        pipeline.finish()
        while (frame := pipeline["out"].pull(10)) is not None:
            ages.append((time.monotonic_ns() - frame.arrival_ns) / 1e6)
        received = pipeline["r"].received
        dropped = sum(pipeline["r"].drops.values()) + sum(pipeline["d"].drops.values())
    late = max(ages[2:-1])
    return (
        f"{summary('200 ms a frame', ages[2:-1])}, oldest {late:.0f} ms; received {received}, "
        f"delivered {len(ages)}, dropped {dropped}, unaccounted {received - len(ages) - dropped}"
    )


def main() -> None:
    """Runs both parts."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    slow_seconds = float(sys.argv[2]) if len(sys.argv) > 2 else SLOW_SECONDS
    with server_process(1920, 1080, RATE) as url:
        for transport in ("tcp", "udp"):
            print(summary(f"1080p30 over {transport}", live_ages_ms(url, seconds, transport)))
        print(slow_consumer(url, slow_seconds))


if __name__ == "__main__":
    main()
