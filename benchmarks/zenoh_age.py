"""Age of a record on arrival in another process, compared with a bare put of the same bytes.

Run it:  python benchmarks/zenoh_age.py

A video file is decoded and paced at 30 frames a second; each frame is stamped as it reaches zenohsink, so
that the age is what zenohsink, zenoh on loopback and the decoding of the record add to the pipeline's own.
Every second message is a bare put, stamped and received the same way. Limit: 5 ms at the 99th percentile.
"""

from __future__ import annotations

import json
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import cast

import numpy as np
import zenoh

from streamkit import Capture, Frame, Pipeline, Track, Tracks, TrackState, encode_record, track_record
from streamkit.testing import Harness
from streamkit_zenoh import TrackSubscriber
from streamkit_zenoh.wire.numbering import Stamp
from streamkit_zenoh.zenohsink import ZenohSink

FRAMES = 600
TRACKS = 20


def subscribe(endpoint: str) -> None:
    """The other process: prints key and age of each record, us."""
    with TrackSubscriber("bench/*", connect=endpoint, ring=1000, ends_with_publisher=True) as subscriber:
        for update in subscriber.updates():
            now_ns = time.time_ns()
            if update.record is not None and update.record.capture_ns is not None:
                print(json.dumps([update.key, (now_ns - update.record.capture_ns) / 1e3]), flush=True)


def publish(location: str, endpoint: str) -> None:
    """Plays the file into zenohsink and a bare publisher in turn."""
    tracks = Tracks(
        tuple(
            Track(number, TrackState.CONFIRMED, 1.5, 2.5, 3.0, 4.0, 0.1, (1.0, 2.0), np.eye(2), 0.5, 7)
            for number in range(TRACKS)
        )
    )
    with (
        Harness("zenohsink", key="bench/ours", listen=endpoint, wait_subscribers=1) as sink,
        Pipeline.parse(f"filesrc location={location} ! decode ! appsink name=out sync=true") as pipeline,
    ):
        element = cast(ZenohSink, sink.element)
        assert element._publication is not None
        session = element._publication.session
        bare = session.declare_publisher(
            "bench/bare/tracks", congestion_control=zenoh.CongestionControl.BLOCK
        )
        pipeline.play()
        for number, frame in enumerate(pipeline["out"]):
            stamped: Frame = frame.replace(capture=Capture(time.time_ns(), "file")).attach(tracks)
            if number % 2:
                record = track_record(stamped, source="bench/bare", published_ns=time.time_ns())
                bare.put(encode_record(record), attachment=Stamp(1, number).attachment())
            else:
                element.render(stamped)
        sink.drain()


def main() -> None:
    """Runs it and prints percentiles."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with tempfile.TemporaryDirectory() as folder:
        location = Path(folder) / "flight.mp4"
        text = f"videotestsrc num-buffers={FRAMES} ! video/x-raw, width=320, height=240, framerate=30/1"
        Pipeline.parse(f"{text} ! videofilesink location={location}").run(timeout_s=120)
        other = subprocess.Popen(
            [sys.executable, __file__, "subscribe", endpoint], stdout=subprocess.PIPE, text=True
        )
        publish(str(location), endpoint)
        lines = [json.loads(line) for line in other.communicate(timeout=30)[0].splitlines()]
    for name, key in (("zenohsink", "bench/ours/tracks"), ("bare put", "bench/bare/tracks")):
        # The first ones include imports and connections.
        ages = [age / 1e3 for found, age in lines if found == key][10:]
        cuts = statistics.quantiles(ages, n=100)
        print(f"{name:10s} {len(ages)} records  median {cuts[49]:.2f} ms  99th percentile {cuts[98]:.2f} ms")


if __name__ == "__main__":
    if sys.argv[1:2] == ["subscribe"]:
        subscribe(sys.argv[2])
    else:
        main()
