"""Every record delivered or counted: three subscribers and a router, at full speed and through failures.

Run it:  python benchmarks/zenoh_delivery.py

1. 100 000 records at full speed through a router to three subscribers in processes of their own, once as fast
   as the stream comes (what does not fit is dropped and counted) and once lossless (the stream waits).
2. The router is killed and started again ten times while records come; then the publisher is killed.
Each subscriber must account for every number: what it received and what it counts as lost make the whole.
"""

from __future__ import annotations

import json
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, cast

SUBSCRIBERS = 3
IDLE_S = 4.0
RECORDS = 100_000
RESTARTS = 10


def publish(key: str, endpoint: str, count: int, rate: float, patience_s: float) -> None:
    """A process: pushes frames of three tracks into zenohsink, and prints what was dropped."""
    import numpy as np

    from streamkit import Frame, Track, Tracks, TrackState, raw_video_caps
    from streamkit.testing import Harness
    from streamkit_zenoh.zenohsink import ZenohSink

    tracks = tuple(
        Track(number, TrackState.CONFIRMED, 1.5, 2.5, 3.0, 4.0, 0.1, (1.0, 2.0), np.eye(2), 0.5, 7)
        for number in range(3)
    )
    frame = Frame(np.zeros((4, 8), np.uint8), raw_video_caps("GRAY8", 8, 4), arrival_ns=1).attach(
        Tracks(tracks)
    )
    properties = {"key": key, "connect": endpoint, "mode": "client", "patience_s": patience_s}
    with Harness("zenohsink", **properties) as harness:
        sink = cast(ZenohSink, harness.element)
        sys.stdin.readline()
        began_s = time.monotonic()
        for seq in range(count):
            sink.render(frame.replace(seq=seq, pts=seq))
            if rate:
                time.sleep(max(0.0, began_s + seq / rate - time.monotonic()))
        spent_s = time.monotonic() - began_s
        harness.drain()
    say(event="published", count=count, dropped=sum(harness.element.drops.values()), spent_s=spent_s)


def subscribe(key: str, endpoint: str, last: int) -> None:
    """A process: receives until the last number or a timeout, and prints its counts."""
    from streamkit_zenoh import TrackSubscriber

    seqs: list[int] = []
    publishers = -1
    with TrackSubscriber(key, connect=endpoint, mode="client", ring=200_000) as subscriber:
        idle_since_s = time.monotonic()
        while time.monotonic() - idle_since_s < IDLE_S or not seqs:
            record = subscriber.get(0.05)
            if subscriber.counts.publishers != publishers:
                publishers = subscriber.counts.publishers
                say(event="publishers", count=publishers)
            if record is not None:
                idle_since_s = time.monotonic()
                if not seqs:
                    say(event="first", seq=record.seq)
                seqs.append(record.seq)
                if record.seq == last:
                    break
        counts = subscriber.counts
    missing = seqs[-1] - seqs[0] + 1 - len(seqs) if seqs else 0
    say(
        event="received", first=seqs[0], last=seqs[-1], received=len(seqs), missing=missing, lost=counts.lost,
        overwritten=counts.overwritten, bad=counts.bad, in_order=seqs == sorted(set(seqs)),
    )  # fmt: skip


def route(endpoint: str) -> None:
    """A process: a zenoh session in router mode."""
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    say(event="up")
    sys.stdin.read()
    session.close()


def say(**facts: Any) -> None:
    """Prints a line of JSON to the parent process."""
    print(json.dumps({**facts, "at_ns": time.monotonic_ns()}), flush=True)


class Child:
    """One of the processes above, and the lines it prints."""

    def __init__(self, *arguments: object) -> None:
        command = [sys.executable, __file__, *map(str, arguments)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._lines: queue.Queue[dict[str, Any]] = queue.Queue()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(json.loads(line))

    def expect(self, limit_s: float, **facts: Any) -> dict[str, Any]:
        """The next line with these values."""
        deadline_s = time.monotonic() + limit_s
        while True:
            line = self._lines.get(timeout=max(0.01, deadline_s - time.monotonic()))
            if facts.items() <= line.items():
                return line

    def go(self) -> None:
        """Starts publishing."""
        assert self.process.stdin is not None
        self.process.stdin.write("go\n")
        self.process.stdin.flush()

    def kill(self) -> int:
        """Kills it; returns the time, monotonic ns."""
        self.process.send_signal(signal.SIGKILL)
        at_ns = time.monotonic_ns()
        self.process.wait(10)
        self._reader.join(10)
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                stream.close()
        return at_ns


def free_endpoint() -> str:
    """A free endpoint on loopback."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def with_children(scenario: Callable[[list[Child], str], dict[str, Any]]) -> dict[str, Any]:
    """Runs a scenario, and ends its processes."""
    children: list[Child] = []
    try:
        return scenario(children, free_endpoint())
    finally:
        for child in children:
            child.kill()


def started(children: list[Child], *arguments: object) -> Child:
    """A new process of the scenario."""
    children.append(Child(*arguments))
    return children[-1]


def full_speed(records: int, patience_s: float) -> dict[str, Any]:
    """Three subscribers through a router at full speed: what each received and counted."""

    def scenario(children: list[Child], endpoint: str) -> dict[str, Any]:
        started(children, "route", endpoint).expect(30, event="up")
        subscribers = [
            started(children, "subscribe", "bench/1", endpoint, records - 1) for _ in range(SUBSCRIBERS)
        ]
        publisher = started(children, "publish", "bench/1", endpoint, records, 0, patience_s)
        for subscriber in subscribers:
            subscriber.expect(60, event="publishers", count=1)
        publisher.go()
        published = publisher.expect(600, event="published")
        return {
            "published": published,
            "subscribers": [one.expect(60, event="received") for one in subscribers],
        }

    return with_children(scenario)


def failures(restarts: int, records_between: int, rate: float) -> dict[str, Any]:
    """Router killed and restarted, then the publisher killed: time of detection, and counts."""

    def scenario(children: list[Child], endpoint: str) -> dict[str, Any]:
        router = started(children, "route", endpoint)
        router.expect(30, event="up")
        subscribers = [started(children, "subscribe", "bench/1", endpoint, -1) for _ in range(SUBSCRIBERS)]
        publisher = started(children, "publish", "bench/1", endpoint, 10**9, rate, 0.0)
        for subscriber in subscribers:
            subscriber.expect(60, event="publishers", count=1)
        publisher.go()
        noticed_s, back_s = [], []
        for _ in range(restarts):
            time.sleep(records_between / rate)
            killed_ns = router.kill()
            noticed_s += [
                elapsed_s(one.expect(20, event="publishers", count=0), killed_ns) for one in subscribers
            ]
            router = started(children, "route", endpoint)
            up_ns = router.expect(30, event="up")["at_ns"]
            back_s += [elapsed_s(one.expect(20, event="publishers", count=1), up_ns) for one in subscribers]
        time.sleep(records_between / rate)
        killed_ns = publisher.kill()
        dead_s = [elapsed_s(one.expect(20, event="publishers", count=0), killed_ns) for one in subscribers]
        received = [one.expect(60, event="received") for one in subscribers]
        return {"noticed_s": noticed_s, "back_s": back_s, "publisher_dead_s": dead_s, "subscribers": received}

    return with_children(scenario)


def elapsed_s(line: dict[str, Any], since_ns: int) -> float:
    """Seconds from a time to a line."""
    return float(line["at_ns"] - since_ns) / 1e9


def main() -> None:
    """Runs all and prints a table."""
    for name, patience_s in (("newest wins", 0.0), ("lossless", 30.0)):
        found = full_speed(RECORDS, patience_s)
        published = found["published"]
        rate = published["count"] / published["spent_s"]
        print(
            f"{name}: {published['count']} records at {rate:.0f}/s, "
            f"dropped by the sink {published['dropped']}"
        )
        for one in found["subscribers"]:
            whole = one["received"] + one["lost"] + one["overwritten"]
            print(
                f"  first {one['first']}  received {one['received']}  lost {one['lost']}"
                f"  overwritten {one['overwritten']}"
                f"  bad {one['bad']}  in order {one['in_order']}  unaccounted {published['count'] - whole}"
            )
    found = failures(RESTARTS, 500, 500.0)
    print(f"router killed {RESTARTS} times: noticed within {max(found['noticed_s']):.2f} s, "
          f"back within {max(found['back_s']):.2f} s of its return")  # fmt: skip
    print(f"publisher killed: known within {max(found['publisher_dead_s']):.2f} s")
    for one in found["subscribers"]:
        print(f"  received {one['received']}  missing {one['missing']}  counted as lost {one['lost']}")


if __name__ == "__main__":
    name, *rest = sys.argv[1:] or ["main"]
    if name == "publish":
        publish(rest[0], rest[1], int(rest[2]), float(rest[3]), float(rest[4]))
    elif name == "subscribe":
        subscribe(rest[0], rest[1], int(rest[2]))
    elif name == "route":
        route(rest[0])
    else:
        main()
