"""Follows a streamkit publisher with nothing but zenoh and json: docs/zenoh.md describes what travels.

    python subscribe.py KEY [ENDPOINT] [COUNT]

Prints one line per record; says what was missed, and when the publisher comes and goes. ENDPOINT is where the
publisher listens, on this machine the first free port from 7450 on, or the router that it connects to.
"""

import json
import queue
import sys

import zenoh

WAIT_S = 10.0  # then it says that nothing comes


class Gaps:
    """Counts what was missed: each message carries `RUN NUMBER` as its attachment."""

    def __init__(self) -> None:
        self.last: dict[tuple[str, str], int] = {}

    def missed_before(self, sample: zenoh.Sample) -> int | None:
        """How many messages of this key are missing before this one; None where it was here before."""
        if sample.attachment is None:
            return 0
        run, number_text = sample.attachment.to_string().split("\n")[0].split(" ")
        stream, number = (str(sample.key_expr), run), int(number_text)
        last = self.last.get(stream)
        if last is not None and number <= last:
            return None
        self.last[stream] = number
        return 0 if last is None else number - last - 1


def main(key: str, endpoint: str = "tcp/127.0.0.1:7450", count: int = -1) -> None:
    """Prints records until the publisher has gone, or so many."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    news: queue.Queue[zenoh.Sample | zenoh.Reply] = queue.Queue(maxsize=1000)
    gaps = Gaps()
    with zenoh.open(config) as session:
        # First, so that a publisher is seen before its records.
        session.liveliness().declare_subscriber(f"{key}/alive", news.put, history=True)
        session.declare_subscriber(f"{key}/tracks", news.put)
        # Who comes late asks for the last record.
        session.get(f"{key}/tracks", news.put)
        while count:
            try:
                item = news.get(timeout=WAIT_S)
            except queue.Empty:
                print(f"no message of {key} at {endpoint} for {WAIT_S:g} s", file=sys.stderr, flush=True)
                continue
            sample = item.ok if isinstance(item, zenoh.Reply) else item
            if sample is None:
                continue
            if str(sample.key_expr).endswith("/alive"):
                print("publisher", "there" if sample.kind == zenoh.SampleKind.PUT else "gone", flush=True)
                if sample.kind == zenoh.SampleKind.DELETE:
                    return
                continue
            missed = gaps.missed_before(sample)
            if missed is None:
                continue
            if missed:
                print("missed", missed, flush=True)
            record = json.loads(sample.payload.to_bytes())
            targets = [f"#{track['id']} {track['x']:.1f} {track['y']:.1f}" for track in record["tracks"]]
            print("record", record["seq"], *targets, flush=True)
            count -= 1


if __name__ == "__main__":
    main(sys.argv[1], *sys.argv[2:3], *map(int, sys.argv[3:4]))
