"""zenohsink: every frame's record arrives, also in another process; nothing is lost unseen."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zenoh

from streamkit import (
    Capture,
    ElementFailure,
    Frame,
    Pipeline,
    ResourceError,
    TrackRecord,
    Tracks,
    decode_record,
    raw_video_caps,
)
from streamkit.testing import Harness

Opener = Callable[..., zenoh.Session]
RECEIVER = Path(__file__).with_name("receiver.py")


class _Subscriber:
    """Keeps what a plain zenoh subscriber receives."""

    def __init__(self, session: zenoh.Session, expression: str, wanted: int) -> None:
        self.samples: list[zenoh.Sample] = []
        self.enough = threading.Event()
        self.first = threading.Event()
        self._wanted = wanted
        self._subscriber = session.declare_subscriber(
            expression, zenoh.handlers.Callback(self._take, indirect=False)
        )

    def _take(self, sample: zenoh.Sample) -> None:
        self.samples.append(sample)
        self.first.set()
        if len(self.samples) == self._wanted:
            self.enough.set()

    def records(self) -> list[TrackRecord]:
        assert self.enough.wait(20)
        return [decode_record(sample.payload.to_bytes()) for sample in self.samples]


def _frame(seq: int, capture: Capture | None = None) -> Frame:
    caps = raw_video_caps("GRAY8", 4, 2)
    frame = Frame(np.zeros((2, 4), np.uint8), caps, pts=seq * 40, seq=seq, arrival_ns=1, capture=capture)
    return frame.attach(Tracks())


def _start_receiver(*arguments: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, str(RECEIVER), *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    return process


def _received(process: subprocess.Popen[str]) -> list[TrackRecord]:
    out, err = process.communicate(timeout=40)
    assert process.returncode == 0, err
    return [decode_record(line) for line in out.splitlines()]


@pytest.mark.parametrize("meeting", ["found", "named"])
def test_every_record_reaches_another_process(key: str, endpoint: str, meeting: str) -> None:
    """Two processes, no router: with the receiver there, each of 400 records arrives, in order."""
    connect, listen = (f" connect={endpoint}", f" listen={endpoint}") if meeting == "named" else ("", "")
    receiver = _start_receiver(f"zenohsrc key={key}{connect} ! appsink name=out")
    Pipeline.parse(
        f"videotestsrc num-buffers=400 ! zenohsink key={key}{listen} "
        "wait-subscribers=1 max-queue=16 patience-s=10"
    ).run(timeout_s=40)
    records = _received(receiver)
    assert [record.seq for record in records] == list(range(400))
    assert {record.source for record in records} == {key}
    assert {record.dropped for record in records} == {0}
    assert (records[0].width, records[0].height) == (320, 240)


def test_two_receivers_are_waited_for(key: str) -> None:
    """With wait-subscribers=2 both processes get every record, whichever starts first."""
    receivers = [_start_receiver(f"zenohsrc key={key} ! appsink name=out") for _ in range(2)]
    Pipeline.parse(f"videotestsrc num-buffers=50 ! zenohsink key={key} wait-subscribers=2 patience-s=10").run(
        timeout_s=40
    )
    for receiver in receivers:
        assert [record.seq for record in _received(receiver)] == list(range(50))


def test_the_record_is_that_of_the_frame(open_test_session: Opener, key: str) -> None:
    """JSON at KEY/tracks, with source, times and age, for subscribers of any make."""
    subscriber = _Subscriber(open_test_session(), f"{key}/tracks", 1)
    before_ns = time.time_ns()
    capture = Capture(before_ns - 50_000_000, "rtcp")
    with Harness("zenohsink", key=key, wait_subscribers=1) as harness:
        harness.push(_frame(120, capture))
        (record,) = subscriber.records()
        harness.drain()
    assert str(subscriber.samples[0].encoding) == "application/json;streamkit.tracks/1"
    assert (record.source, record.seq, record.pts_ns) == (key, 120, 4800)
    assert (record.capture_ns, record.capture_origin) == (capture.utc_ns, "rtcp")
    assert record.published_ns is not None
    assert before_ns <= record.published_ns <= time.time_ns()
    assert record.age_ms is not None
    assert record.age_ms >= 50.0


def test_records_pass_on_as_they_are(open_test_session: Opener, key: str) -> None:
    """A bridge from zenohsrc to zenohsink changes nothing in the record."""
    from streamkit import encode_record, track_record

    subscriber = _Subscriber(open_test_session(), f"{key}/tracks", 1)
    payload = encode_record(track_record(_frame(5), source="uav/first", published_ns=7))
    text = f"appsrc name=in caps=application/x-tracks ! zenohsink key={key} wait-subscribers=1"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        pipeline["in"].push(payload)
        pipeline["in"].end()
        pipeline.wait(20)
    assert subscriber.enough.wait(10)
    assert subscriber.samples[0].payload.to_bytes() == payload


def test_waiting_for_receivers_is_bounded(key: str) -> None:
    """Nobody comes: the error says how many were waited for, where, and what to do."""
    text = f"videotestsrc num-buffers=1 ! zenohsink key={key} wait-subscribers=1 wait-timeout-s=0.1"
    with pytest.raises(
        ElementFailure, match=f"wait-subscribers=1: not there at {key}/tracks within 0.1 s; start them"
    ):
        Pipeline.parse(text).run(timeout_s=20)


def test_a_pipeline_that_waits_can_be_stopped(key: str) -> None:
    """A stop ends the wait for receivers at once."""
    with Pipeline.parse(
        f"videotestsrc ! zenohsink key={key} wait-subscribers=1 wait-timeout-s=3600"
    ) as pipeline:
        pipeline.play()
        started = time.monotonic()
        pipeline.stop()
        assert time.monotonic() - started < 5.0


def test_a_stuck_receiver_holds_up_nobody(endpoint: str, key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Records that find no room are dropped and counted, the stuck receiver is cut off, and closing ends."""
    monkeypatch.setattr("streamkit_zenoh.zenohsink.FINISH_LIMIT_S", 1.0)
    receiver = _start_receiver(f"zenohsrc key={key} connect={endpoint} ! appsink name=out")
    try:
        with Harness(
            "zenohsink", key=key, listen=endpoint, wait_subscribers=1, max_queue=4, cut_off_s=1
        ) as harness:
            # The kernel holds some megabytes before a sender is held up; large records fill them soon.
            frame = _frame(1).attach(_many_tracks(2000))
            harness.push(frame)
            receiver.send_signal(signal.SIGSTOP)
            started = time.monotonic()
            never = threading.Event()
            while not any("was cut off" in message.text for message in harness.messages):
                harness.push(frame)
                never.wait(0.01)
                assert time.monotonic() - started < 20
            assert harness.element.drops["tracks: queue full"] >= 1
            harness.drain()
    finally:
        receiver.kill()
        receiver.communicate(timeout=10)


def test_drops_are_told_in_the_records_that_follow(open_test_session: Opener, key: str) -> None:
    """`dropped` counts what the publisher could not deliver so far."""
    subscriber = _Subscriber(open_test_session(), f"{key}/tracks", 2)
    with Harness("zenohsink", key=key, wait_subscribers=1) as harness:
        harness.push(_frame(0))
        assert subscriber.first.wait(10)
        harness.element._publication.records.count_lost(3, "queue full")
        harness.push(_frame(1))
        assert [record.dropped for record in subscriber.records()] == [0, 3]


def _many_tracks(count: int) -> Tracks:
    from streamkit import Track, TrackState

    covariance = np.eye(2)
    return Tracks(
        tuple(
            Track(number, TrackState.CONFIRMED, 1.5, 2.5, 3.0, 4.0, 0.1, (1.0, 2.0), covariance, 0.5, 7)
            for number in range(count)
        )
    )


@pytest.mark.parametrize(
    ("properties", "text"),
    [
        ({"key": "uav/*"}, "must not have wildcards"),
        ({"key": "/uav"}, "for example uav/1"),
        ({"listen": "here"}, "PROTOCOL/HOST:PORT"),
        ({"listen": "tcp/192.0.2.200:7447"}, "zenoh"),
        ({"config": "/no/such/file.json5"}, "zenoh configuration"),
    ],
)
def test_what_cannot_work_is_an_error_at_start(properties: dict[str, str], text: str) -> None:
    """Keys, endpoints and files are judged before the first frame."""
    with pytest.raises(ResourceError, match=text):
        Harness("zenohsink", **properties)


def test_an_endpoint_where_nobody_is_is_told(endpoint: str, key: str) -> None:
    """A peer goes on trying, and says so."""
    with Harness("zenohsink", key=key, connect=endpoint) as harness:
        assert any(f"nobody answers at {endpoint} yet" in message.text for message in harness.messages)


def test_graphs_show_no_secret(key: str) -> None:
    """What an endpoint carries behind # may be a private key."""
    pipeline = Pipeline.parse(
        f'fakesrc ! zenohsink name=z key={key} connect="tls/h:1#connect_private_key_base64=SECRET"'
    )
    assert "SECRET" not in str(pipeline["z"].settings())
    assert pipeline["z"].settings()["connect"] == "tls/h:1#***"


def test_no_thread_is_left(key: str) -> None:
    """After a run only the threads that were there before are there."""
    before = set(threading.enumerate())
    Pipeline.parse(f"videotestsrc num-buffers=3 ! zenohsink key={key}").run(timeout_s=20)
    assert set(threading.enumerate()) <= before
