"""Cost of zenohsink per frame of 50 tracks, compared with a bare `publisher.put` of the same bytes.

Run it:  python benchmarks/zenoh_cost.py

Both publish to the same subscriber in another process, in turn, at 100 frames a second. The first figure is
what the streaming thread waits for; `process` is the work of all threads of this process, making the record
included. Each call follows a little work on a frame, as in a pipeline: the first call of a thread that has
just been asleep takes some 40 us more, whatever it does.
Limits: 1.5 times the bare put; 60 us without a subscriber.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from typing import cast

import numpy as np
import zenoh

from streamkit import (
    Capture,
    Frame,
    Registration,
    Track,
    Tracks,
    TrackState,
    encode_record,
    raw_video_caps,
    track_record,
)
from streamkit.testing import Harness
from streamkit_zenoh.configuration import SessionSettings
from streamkit_zenoh.session import close_session, open_session
from streamkit_zenoh.zenohsink import ZenohSink

ENDPOINT = "tcp/127.0.0.1:17601"
TRACKS = 50
FRAMES = 300
ROUNDS = 5
PAUSE_S = 0.01


def frame_of_many() -> Frame:
    """A frame with 50 tracks, as from a tracker."""
    noise = np.random.default_rng(0).normal(size=(TRACKS, 8))
    covariance = np.array([[1.53, 0.21], [0.21, 0.77]])
    tracks = tuple(
        Track(
            number,
            TrackState.CONFIRMED,
            900 + 200 * row[0],
            500 + 100 * row[1],
            31 + row[2],
            14 + row[3],
            row[4],
            (10 * row[5], 10 * row[6]),
            covariance,
            0.87,
            3_120_000_000,
        )
        for number, row in enumerate(noise)
    )
    frame = Frame(
        np.zeros((1080, 1920), np.uint8),
        raw_video_caps("GRAY8", 1920, 1080),
        pts=4_800_000_000,
        seq=120,
        capture=Capture(time.time_ns(), "rtcp"),
    )
    return frame.attach(Tracks(tracks), Registration(np.eye(3), np.eye(3)))


def median_us(frame: Frame, call: Callable[[], object]) -> tuple[float, float]:
    """Median wall time of a call, and CPU time of the process per call, us."""
    walls = []
    began_s = time.process_time()
    for _ in range(FRAMES):
        for seq in range(20):
            frame.replace(seq=seq)
        before = time.perf_counter()
        call()
        walls.append(time.perf_counter() - before)
        time.sleep(PAUSE_S)
    return statistics.median(walls) * 1e6, (time.process_time() - began_s) / FRAMES * 1e6


def subscribe() -> None:
    """The other process: receives and discards."""
    session = open_session(SessionSettings(connect=ENDPOINT))
    handler = zenoh.handlers.Callback(lambda _sample: None, indirect=False)
    held = [session.declare_subscriber(key, handler) for key in ("bench/bare", "bench/ours/tracks")]
    sys.stdin.read()
    del held
    close_session(session, 5.0)


def main() -> None:
    """Runs the three in turn and prints medians and ratios."""
    frame = frame_of_many()
    payload = encode_record(track_record(frame, source="bench/ours", published_ns=time.time_ns()))
    with (
        Harness("zenohsink", key="bench/ours", listen=ENDPOINT, status=False) as ours,
        Harness("zenohsink", key="bench/alone", listen="tcp/127.0.0.1:0", status=False) as alone,
    ):
        other = subprocess.Popen([sys.executable, __file__, "subscribe"], stdin=subprocess.PIPE)
        sink, idle = cast(ZenohSink, ours.element), cast(ZenohSink, alone.element)
        publication = sink._publication
        assert publication is not None
        session = publication.session
        bare = session.declare_publisher(
            "bench/bare",
            congestion_control=zenoh.CongestionControl.BLOCK,
            reliability=zenoh.Reliability.RELIABLE,
        )
        while not (bare.matching_status.matching and publication.records.has_subscriber):  # type: ignore[attr-defined]
            time.sleep(0.05)
        calls: dict[str, Callable[[], object]] = {
            "bare put": lambda: bare.put(payload),
            "zenohsink": lambda: sink.render(frame),
            "zenohsink, no subscriber": lambda: idle.render(frame),
        }
        rounds = [{name: median_us(frame, call) for name, call in calls.items()} for _ in range(ROUNDS)]
        dropped = sum(ours.element.drops.values())
        other.communicate(timeout=10)
    print(f"{len(payload)} bytes, {TRACKS} tracks, {1 / PAUSE_S:.0f} frames/s, dropped {dropped}")
    for name in calls:
        wall = statistics.median(one[name][0] for one in rounds)
        ratio = statistics.median(one[name][0] / one["bare put"][0] for one in rounds)
        process = statistics.median(one[name][1] for one in rounds)
        print(f"{name:27s} {wall:7.1f} us per frame  ratio {ratio:5.2f}   process {process:7.1f} us")


if __name__ == "__main__":
    if sys.argv[1:] == ["subscribe"]:
        subscribe()
    else:
        main()
