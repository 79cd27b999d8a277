"""Hostile zenoh messages to every kind of receiver: each survives, within bounds and without errors.

A hostile session sends mutated records, status and images, extreme numbers, forged stamps, garbage like
KLV, deletions, garbage as answers, and tokens that come and go. After each batch one good record must pass
every receiver within 5 s. Receivers are processes of their own: what they write to stderr, their descriptors
and their memory are watched. Exit code 1 where one of them ends, hangs, reports an error, leaks or grows.

Run it:  python benchmarks/fuzz_zenoh.py [--minutes N] [--seed N]
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
import zenoh

from streamkit import (
    TRACKS_SCHEMA,
    Frame,
    Pipeline,
    Registration,
    TrackRecord,
    Tracks,
    raw_video_caps,
    track_record,
)
from streamkit_zenoh import TrackSubscriber
from streamkit_zenoh.configuration import SessionSettings
from streamkit_zenoh.session import close_session, open_session
from streamkit_zenoh.wire.encodings import Codec, Encoding
from streamkit_zenoh.wire.frame_header import frame_header
from streamkit_zenoh.wire.images import ImageFormat, encode_image
from streamkit_zenoh.wire.messages import STATUS_SCHEMA, StatusRecord, StreamStatus
from streamkit_zenoh.wire.numbering import Stamp

KEY = "fuzz/1"
BATCH = 400
ANSWER_LIMIT_S = 5.0
START_LIMIT_S = 60.0
GROWTH_LIMIT_MB = 16.0
GOOD_FROM = 10**15
RUN = 1_763_690_000_171_000_000
EXTREMES = (0, -1, 2**31, 2**63, 10**19 - 1, 10**40, 1e308, float("nan"), None, "", [], {}, True, "\ud800")
KLV_KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
COMPLAINTS = ("Traceback", "callback error", "panicked", "Exception", "Already borrowed")
KINDS = ("subscriber", "updates", "zenohsrc", "images", "subscribe")

Message = tuple[str, bytes, str, bytes]


def receive(kind: str, endpoint: str) -> None:
    """A process: receives until the end of its input, and prints the number of each valid record."""
    if kind in ("subscriber", "updates"):
        key = f"{KEY}/track/*" if kind == "updates" else KEY
        with TrackSubscriber(key, connect=endpoint, ring=4096) as subscriber:
            threading.Thread(target=lambda: (sys.stdin.read(), subscriber.close())).start()
            for record in subscriber:
                say(record.seq)
        return
    what = "frame" if kind == "images" else "tracks"
    text = f"zenohsrc key={KEY} connect={endpoint} receive={what} eos-on-disconnect=false ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()

        def finish_with_input() -> None:
            sys.stdin.read()
            pipeline.finish()

        threading.Thread(target=finish_with_input).start()
        for frame in pipeline["out"]:
            say(frame.seq)


def say(seq: int) -> None:
    """A line for a valid record."""
    if seq >= GOOD_FROM:
        print(json.dumps({"seq": seq}), flush=True)


class Receiver:
    """One of the processes above, and its observed behaviour."""

    def __init__(self, kind: str, endpoint: str) -> None:
        self.kind = kind
        self.errors: list[str] = []
        self.memory_mb: list[float] = []
        self.descriptors: list[int] = []
        self._last = -1
        self._changed = threading.Condition()
        command = [sys.executable, __file__, "--receive", kind, endpoint]
        if kind == "subscribe":
            binary = str(Path(sys.executable).with_name("streamkit"))
            command = [
                binary,
                "subscribe",
                KEY,
                "--connect",
                endpoint,
                "--stay",
                "--format",
                "jsonl",
                "--gaps",
            ]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self._readers = [threading.Thread(target=self._read), threading.Thread(target=self._read_complaints)]
        for reader in self._readers:
            reader.start()

    def _read(self) -> None:
        for line in self.process.stdout or ():
            seq = json.loads(line)["seq"]
            if seq >= GOOD_FROM:
                with self._changed:
                    self._last = seq
                    self._changed.notify_all()

    def _read_complaints(self) -> None:
        follows = 0  # lines of a traceback to keep
        for line in self.process.stderr or ():
            follows = 30 if any(word in line for word in COMPLAINTS) else follows - 1
            if follows > 0 and len(self.errors) < 60:
                self.errors.append(f"{self.kind}: stderr: {line.rstrip()[:300]}")

    def has_passed(self, seq: int, limit_s: float) -> bool:
        """Whether this valid record is printed within the time limit."""
        with self._changed:
            return self._changed.wait_for(lambda: self._last == seq, limit_s)

    def look(self) -> None:
        """Stores memory and descriptors."""
        folder = Path(f"/proc/{self.process.pid}")
        status = folder.joinpath("status").read_text(encoding="ascii")
        resident_kb = next(line.split()[1] for line in status.splitlines() if line.startswith("VmRSS"))
        self.memory_mb.append(int(resident_kb) / 1024)
        self.descriptors.append(len(os.listdir(folder / "fd")))

    def end(self) -> list[str]:
        """Ends it as a user would; returns the violations."""
        began_s = time.monotonic()
        try:
            if self.kind == "subscribe":
                self.process.send_signal(signal.SIGINT)
            elif self.process.stdin is not None:
                self.process.stdin.close()
            code = self.process.wait(ANSWER_LIMIT_S)
            wrong = [f"{self.kind}: exit code {code}"] if code else []
        except (subprocess.TimeoutExpired, BrokenPipeError):
            wrong = [f"{self.kind}: not ended after {time.monotonic() - began_s:.1f} s"]
        self.process.kill()
        self.process.wait(10)
        for reader in self._readers:
            reader.join(10)
        return wrong

    def growth(self) -> tuple[float, int]:
        """Growth of memory (MB) and descriptors from the second tenth to the last."""
        tenth = max(1, len(self.memory_mb) // 10)
        early, late = slice(tenth, 2 * tenth + 1), slice(-tenth, None)
        memory = median(self.memory_mb[late]) - median(self.memory_mb[early])
        return memory, max(self.descriptors[late]) - max(self.descriptors[early])


class HostileSender:
    """Makes hostile and valid messages."""

    def __init__(self, seed: int) -> None:
        self._chance = random.Random(seed)
        self._codecs = {form: Codec(TrackRecord, TRACKS_SCHEMA, form) for form in Encoding}
        self._status = {form: Codec(StatusRecord, STATUS_SCHEMA, form) for form in Encoding}
        frame = self._frame(1)
        self._image = encode_image(frame.data, ImageFormat.PNG)
        self._header = frame_header(frame, "x", 2, 0, frame.data.shape)
        self._record = track_record(frame, source="x", published_ns=2)
        stream = StreamStatus(
            name="tracks", run=RUN, settled_number=1, published=1, bytes=1, has_subscriber=1, first_number=0
        )
        self._state = StatusRecord(
            schema=STATUS_SCHEMA, source=KEY, state="playing", run=RUN, published_ns=1, uptime_s=1.0,
            frames=1, tracks=0, streams=(stream,), drops=(),
        )  # fmt: skip

    @staticmethod
    def _frame(seq: int) -> Frame:
        frame = Frame(np.zeros((24, 32), np.uint8), raw_video_caps("GRAY8", 32, 24), pts=seq, seq=seq)
        return frame.attach(Tracks(), Registration(np.eye(3), np.eye(3)))

    def good(self, number: int) -> list[Message]:
        """A valid record for each kind of receiver."""
        frame = self._frame(GOOD_FROM + number)
        codec = self._codecs[Encoding.JSON]
        record = codec.encode(track_record(frame, source="good", published_ns=2))
        stamp = Stamp(RUN, number).attachment()
        header = frame_header(frame, "good", 2, 0, frame.data.shape)
        return [
            (f"{KEY}/tracks", record, codec.content_type, stamp),
            (f"{KEY}/track/1", record, codec.content_type, stamp),
            (f"{KEY}/frame", self._image, "image/png", Stamp(RUN, number).attachment(header)),
        ]

    def hostile(self) -> Message:
        """A message of a random kind."""
        chance = self._chance
        form = chance.choice(list(Encoding))
        kind = chance.randrange(8)
        stamp = self._stamp()
        where = chance.choice(("tracks", f"track/{chance.randrange(5000)}"))
        if kind <= 1:
            codec = self._codecs[form]
            return f"{KEY}/{where}", self._mutated(codec.encode(self._record)), codec.content_type, stamp
        if kind == 2:
            status = self._status[form]
            return f"{KEY}/status", self._mutated(status.encode(self._state)), status.content_type, stamp
        if kind == 3:
            payload = self._extreme(self._codecs[Encoding.JSON].encode(self._record))
            return f"{KEY}/{where}", payload, self._codecs[Encoding.JSON].content_type, stamp
        if kind == 4:
            payload = self._extreme(self._status[Encoding.JSON].encode(self._state))
            return f"{KEY}/status", payload, self._status[Encoding.JSON].content_type, stamp
        if kind == 5:
            header = self._extreme(self._header) if chance.random() < 0.5 else self._mutated(self._header)
            image = self._mutated(self._image) if chance.random() < 0.7 else self._image
            return f"{KEY}/frame", image, "image/png", stamp + b"\n" + header
        if kind == 6:
            nested = b"[" * 200_000 if chance.random() < 0.02 else b'{"tracks":' * 50
            return f"{KEY}/{where}", nested, self._codecs[Encoding.JSON].content_type, stamp
        klv = KLV_KEY + bytes([0x80 | chance.randrange(128)]) + chance.randbytes(chance.randrange(600))
        return f"{KEY}/{chance.choice(('tracks', 'status', 'frame'))}", klv, self._encoding(), stamp

    def _encoding(self) -> str:
        words = ("zenoh/bytes", "image/jpeg", "application/json", "application/cbor;x", "x" * 200, "\u0663;")
        return self._chance.choice(words)

    def _stamp(self) -> bytes:
        """A stamp of the publisher's run or another, never with a number that the publisher will use."""
        chance = self._chance
        number = chance.choice((0, 10**9, 10**19 - 1, chance.randrange(10**8, 10**19)))
        run = chance.choice((RUN, RUN, 10**19 - 1, chance.randrange(10**19)))
        stamp = b"%d %d" % (run, number)
        return self._mutated(stamp) if run != RUN and chance.random() < 0.5 else stamp

    def _mutated(self, data: bytes) -> bytes:
        chance = self._chance
        if chance.random() < 0.2:
            return chance.randbytes(chance.randrange(400))
        changed = bytearray(data)
        for _ in range(chance.randrange(1, 8)):
            changed[chance.randrange(len(changed))] = chance.randrange(256)
        if chance.random() < 0.3:
            del changed[chance.randrange(len(changed)) :]
        return bytes(changed)

    def _extreme(self, data: bytes) -> bytes:
        """A JSON object with an unexpected value at a random position."""
        whole = json.loads(data)
        place = whole
        while True:
            key = self._chance.choice(list(place) if isinstance(place, dict) else list(range(len(place))))
            if isinstance(place[key], dict | list) and place[key] and self._chance.random() < 0.8:
                place = place[key]
                continue
            place[key] = self._chance.choice(EXTREMES)
            return json.dumps(whole).encode()


def free_endpoint() -> str:
    """A free endpoint on loopback."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def send_hostile(session: zenoh.Session, sender: HostileSender, chance: random.Random) -> None:
    """Sends a batch with occasional deletions."""
    for _ in range(BATCH):
        key, payload, encoding, attachment = sender.hostile()
        if chance.random() < 0.03:
            session.delete(key, attachment=attachment)
        else:
            put(session, (key, payload, encoding, attachment))


def put(session: zenoh.Session, message: Message) -> None:
    """Sends a message; blocks while zenoh's queue is full."""
    key, payload, encoding, attachment = message
    block = zenoh.CongestionControl.BLOCK
    session.put(key, payload, encoding=encoding, attachment=attachment, congestion_control=block)


def answering(sender: HostileSender) -> Callable[[zenoh.Query], None]:
    """Replies to every query with garbage."""

    def answer(query: zenoh.Query) -> None:
        with query:
            for _ in range(5):
                key, payload, encoding, attachment = sender.hostile()
                if query.key_expr.intersects(key):
                    query.reply(key, payload, encoding=encoding, attachment=attachment)

    return answer


def fuzz(minutes: float, seed: int) -> list[str]:
    """Runs it; returns the violations."""
    endpoint, chance, sender = free_endpoint(), random.Random(seed), HostileSender(seed)
    session = open_session(SessionSettings(listen=endpoint))
    receivers = [Receiver(kind, endpoint) for kind in KINDS]
    violations: list[str] = []
    sent, slowest_s, number, limit_s = 0, 0.0, 0, START_LIMIT_S
    try:
        handler = zenoh.handlers.Callback(answering(HostileSender(seed + 1)), indirect=True)
        session.declare_queryable(f"{KEY}/**", handler)
        wait_for_subscribers(session)
        deadline_s = time.monotonic() + 60 * minutes
        while time.monotonic() < deadline_s and not violations:
            if sent or number:
                token = session.liveliness().declare_token(f"{KEY}/alive")
                send_hostile(session, sender, chance)
                sent += BATCH
                token.undeclare()
            began_s = time.monotonic()
            for message in sender.good(number):
                put(session, message)
            for one in receivers:
                left_s = max(0.0, began_s + limit_s - time.monotonic())
                if not one.has_passed(GOOD_FROM + number, left_s):
                    violations.append(f"{one.kind}: good record {number} has not come in {limit_s:g} s")
                elif one.process.poll() is None:
                    one.look()
            if number:
                slowest_s = max(slowest_s, time.monotonic() - began_s)
            number, limit_s = number + 1, ANSWER_LIMIT_S
    finally:
        violations += [wrong for one in receivers for wrong in one.end()]
        close_session(session, 5.0)
    print(f"{sent} hostile messages, {number} good ones between; slowest good one {slowest_s:.2f} s")
    return violations + [wrong for one in receivers for wrong in judged(one)]


def wait_for_subscribers(session: zenoh.Session) -> None:
    """Waits until every receiver listens."""
    publishers = [session.declare_publisher(f"{KEY}/{name}") for name in ("frame", "track/1")]
    deadline_s = time.monotonic() + START_LIMIT_S
    while time.monotonic() < deadline_s:
        shown = list(session.liveliness().get("streamkit/listening/**"))
        matching = [bool(getattr(one.matching_status, "matching", False)) for one in publishers]
        if len(shown) >= len(KINDS) and all(matching):
            return
        time.sleep(0.1)
    raise SystemExit(f"receivers have not started within {START_LIMIT_S:g} s")


def judged(one: Receiver) -> list[str]:
    """Prints a receiver's figures; returns the violations."""
    if len(one.memory_mb) < 10:
        return [*one.errors, f"{one.kind}: only {len(one.memory_mb)} looks"]
    memory, descriptors = one.growth()
    print(
        f"  {one.kind:<11} memory {one.memory_mb[-1]:6.1f} MB, since the first tenth {memory:+5.1f} MB"
        f"; descriptors {one.descriptors[-1]}, {descriptors:+d}; errors {len(one.errors)}"
    )
    wrong = list(one.errors)
    if memory > GROWTH_LIMIT_MB:
        wrong.append(f"{one.kind}: memory grows by {memory:.1f} MB")
    if descriptors > 0:
        wrong.append(f"{one.kind}: {descriptors} descriptors more")
    return wrong


def main() -> None:
    """Parses the arguments, runs, and prints the violations."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=7)
    arguments = parser.parse_args()
    violations = fuzz(arguments.minutes, arguments.seed)
    print("\n".join(violations) or "no violation")
    raise SystemExit(1 if violations else 0)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--receive"]:
        receive(*sys.argv[2:4])
    else:
        main()
