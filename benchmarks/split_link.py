"""A pipeline split over zenoh, frames made on one machine and tracked on another, over links good and bad.

python benchmarks/split_link.py [--frames 500]    as root, on Linux: it makes two network namespaces

The link between the namespaces is a pair of TUN devices. This process carries their packets, and
delays, limits and drops them as `tc qdisc ... netem` does, which not every kernel has.
"""

from __future__ import annotations

import argparse
import fcntl
import heapq
import json
import os
import random
import select
import struct
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from statistics import mean, quantiles

from streamkit import Pipeline, Tracks
from streamkit.geometry.track import SHOWN_STATES

TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 1, 0x1000  # linux/if_tun.h
QUEUE_S = 0.2  # the router's buffer: more is dropped
SIDES = ("drone", "ground")
ENDPOINT = "tcp/10.9.0.1:7447"
DRONE = "dronetestsrc is-live=true num-buffers={frames} ! zenohsink key=split listen={endpoint} tracks=false \
    track=false frame-rate=1000 frame-width={width} frame-format={format}"
GROUND = "zenohsrc key=split connect={endpoint} receive=frame newest=true max-records=4 ! stitch ! framediff \
    ! particletrack ! appsink name=out max-buffers=1000"


@dataclass(frozen=True)
class Link:
    """A link: Mbit/s, delay of one way, share of lost packets; width to which the drone scales, px."""

    rate: float
    delay_ms: float
    loss: float
    width: int = 0


LINKS = (
    Link(1000, 0, 0.0), Link(50, 20, 0.0), Link(50, 20, 0.01), Link(50, 20, 0.05),
    Link(4, 50, 0.01), Link(4, 50, 0.01, 320),
)  # fmt: skip


def run(*words: str) -> None:
    """A command that must succeed."""
    subprocess.run(words, check=True)


class Wire:
    """Carries packets between the namespaces until it is closed."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.sent = self.lost = 0
        self._ends = [self._device(side, number) for number, side in enumerate(SIDES)]
        self._stop, self._wake = os.pipe()
        self._thread = threading.Thread(target=self._carry)
        self._thread.start()

    @staticmethod
    def _device(side: str, number: int) -> int:
        device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        name = f"split{number}"
        fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH", name.encode(), IFF_TUN | IFF_NO_PI))
        run("ip", "netns", "add", side)
        run("ip", "link", "set", name, "netns", side)
        here, there = f"10.9.0.{number + 1}", f"10.9.0.{2 - number}"
        run("ip", "-n", side, "addr", "add", here, "peer", there, "dev", name)
        run("ip", "-n", side, "link", "set", name, "up")
        run("ip", "-n", side, "link", "set", "lo", "up")
        return device

    def _carry(self) -> None:
        waiting: list[tuple[float, int, int, bytes]] = []  # when, number, to which end, packet
        free_s = [0.0, 0.0]  # when each direction has sent all it holds
        while True:
            wait_s = max(waiting[0][0] - time.monotonic(), 0.0) if waiting else None
            ready, _, _ = select.select([*self._ends, self._stop], [], [], wait_s)
            if self._stop in ready:
                return
            now_s = time.monotonic()
            for end, device in enumerate(self._ends):
                while device in ready:
                    try:
                        packet = os.read(device, 65536)
                    except BlockingIOError:
                        break
                    self.sent += 1
                    begin_s = max(now_s, free_s[end])
                    if random.random() < self.link.loss or begin_s - now_s > QUEUE_S:
                        self.lost += 1
                        continue
                    free_s[end] = begin_s + len(packet) * 8 / self.link.rate / 1e6
                    arrival_s = free_s[end] + self.link.delay_ms / 1e3
                    heapq.heappush(waiting, (arrival_s, self.sent, 1 - end, packet))
            while waiting and waiting[0][0] <= now_s:
                _, _, end, packet = heapq.heappop(waiting)
                os.write(self._ends[end], packet)

    def close(self) -> None:
        """Ends it, and its namespaces."""
        os.write(self._wake, b"x")
        self._thread.join()
        for descriptor in (*self._ends, self._stop, self._wake):
            os.close(descriptor)
        for side in SIDES:
            run("ip", "netns", "delete", side)


def drone(options: argparse.Namespace) -> None:
    """The sending side; prints what its sink dropped."""
    with Pipeline.parse(DRONE.format(endpoint=ENDPOINT, **vars(options))) as pipeline:
        pipeline.run()
        print(json.dumps({row.element: row.dropped for row in pipeline.statistics() if row.dropped}))


def ground(_: argparse.Namespace) -> None:
    """The receiving side; prints frames, drops, lag and targets."""
    lags_ms, targets, numbers = [], [], []
    with Pipeline.parse(GROUND.format(endpoint=ENDPOINT)) as pipeline:
        pipeline.play()
        for frame in pipeline["out"]:
            lags_ms.append((frame.arrival_ns - frame.pts) / 1e6)
            tracks = frame.get(Tracks)
            targets.append(0 if tracks is None else sum(one.state in SHOWN_STATES for one in tracks.tracks))
            numbers.append(frame.seq)
        dropped = {row.element: row.dropped for row in pipeline.statistics() if row.dropped}
    fastest_ms = min(lags_ms)
    cuts = [cut - fastest_ms for cut in quantiles(lags_ms, n=100, method="inclusive")]
    print(json.dumps({
        "frames": len(numbers), "gaps": numbers[-1] - numbers[0] + 1 - len(numbers), "dropped": dropped,
        "lag_ms": [round(cuts[49]), round(cuts[98])], "targets": round(mean(targets), 1),
    }))  # fmt: skip


def measure(link: Link, picture: str, frames: int) -> None:
    """One link."""
    wire = Wire(link)
    try:
        words = [sys.executable, __file__, "--frames", str(frames), "--format", picture]
        words += ["--width", str(link.width), "--side"]
        sides = [
            subprocess.Popen(["ip", "netns", "exec", side, *words, side], stdout=subprocess.PIPE, text=True)
            for side in SIDES
        ]
        said = [side.communicate(timeout=300)[0].strip() for side in sides]
    finally:
        wire.close()
    print(
        f"{link} {picture}\n  packets {wire.sent}, lost {wire.lost}; drone {said[0]}; ground {said[1]}",
        flush=True,
    )


def main() -> None:
    """All links, or one side."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=500)
    parser.add_argument("--format", default="jpeg")
    parser.add_argument("--width", type=int, default=0, help=argparse.SUPPRESS)
    parser.add_argument("--side", choices=SIDES)
    options = parser.parse_args()
    if options.side:
        {"drone": drone, "ground": ground}[options.side](options)
        return
    for link in LINKS:
        measure(link, options.format, options.frames)


if __name__ == "__main__":
    main()
