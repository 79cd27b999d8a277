"""zenohsink: every frame's record arrives, also in another process; every loss is counted."""

import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import zenoh

from streamkit import (
    Capture,
    ElementFailure,
    Frame,
    Pipeline,
    Registration,
    ResourceError,
    Track,
    TrackRecord,
    Tracks,
    TrackState,
    decode_record,
    raw_video_caps,
)
from streamkit.testing import Harness
from streamkit_zenoh.publish.senders import FrameSender
from streamkit_zenoh.wire.encodings import Codec, Encoding
from streamkit_zenoh.wire.messages import StatusRecord
from streamkit_zenoh.wire.numbering import read_attachment
from tests.waiting import wait_for

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
    """Two processes, no router: once the receiver is there, each of 400 records arrives in order."""
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
    """JSON at KEY/tracks, with source, times and age, for any zenoh subscriber."""
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


def test_received_records_are_published_unchanged(open_test_session: Opener, key: str) -> None:
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
    """The error has the number of receivers, the key and a remedy."""
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


def test_a_stuck_receiver_does_not_block_the_pipeline(
    endpoint: str, key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Records that do not fit the queue are dropped and counted, the receiver is cut off, closing ends."""
    monkeypatch.setattr("streamkit_zenoh.zenohsink.FINISH_LIMIT_S", 1.0)
    receiver = _start_receiver(f"zenohsrc key={key} connect={endpoint} ! appsink name=out")
    try:
        with Harness(
            "zenohsink", key=key, listen=endpoint, wait_subscribers=1, max_queue=4, cut_off_s=1
        ) as harness:
            # The kernel buffers some megabytes before a sender blocks; large records fill them soon.
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


def test_later_records_hold_the_number_of_drops(open_test_session: Opener, key: str) -> None:
    """`dropped` counts the records that were not delivered so far."""
    subscriber = _Subscriber(open_test_session(), f"{key}/tracks", 2)
    with Harness("zenohsink", key=key, wait_subscribers=1) as harness:
        harness.push(_frame(0))
        assert subscriber.first.wait(10)
        harness.element._publication.records.count_drop("queue full", 3)
        harness.push(_frame(1))
        assert [record.dropped for record in subscriber.records()] == [0, 3]


def test_drops_of_every_stream_are_counted_while_the_pipeline_plays(key: str) -> None:
    """Those of the senders' threads, too: statistics show them at once and not only at the end."""
    with Harness("zenohsink", key=key, frame_rate=5.0) as harness:
        harness.element._publication.media["frame"].count_drop("replaced by a newer one", 2)
        harness.element._publication.records.count_drop("not sent", 1)
        assert harness.element.drops == {"frame: replaced by a newer one": 2, "tracks: not sent": 1}


def _many_tracks(count: int) -> Tracks:
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
        ({"key": "tracks"}, "must be more than 'tracks'; write for example uav/1"),
        ({"listen": "here"}, "PROTOCOL/HOST:PORT"),
        ({"listen": "tcp/192.0.2.200:7447"}, "zenoh"),
        ({"config": "/no/such/file.json5"}, "zenoh configuration"),
    ],
)
def test_invalid_properties_are_an_error_at_start(properties: dict[str, str], text: str) -> None:
    """Keys, endpoints and files are validated before the first frame."""
    with pytest.raises(ResourceError, match=text):
        Harness("zenohsink", **properties)


def test_an_endpoint_without_answer_is_reported(endpoint: str, key: str) -> None:
    """A peer retries, and posts a warning."""
    with Harness("zenohsink", key=key, connect=endpoint) as harness:
        assert any(f"no session answers at {endpoint} yet" in message.text for message in harness.messages)


def test_graphs_show_no_secret(key: str) -> None:
    """An endpoint may hold a private key after #."""
    pipeline = Pipeline.parse(
        f'fakesrc ! zenohsink name=z key={key} connect="tls/h:1#connect_private_key_base64=SECRET"'
    )
    assert "SECRET" not in str(pipeline["z"].properties_set())
    assert pipeline["z"].properties_set()["connect"] == "tls/h:1#***"


def test_no_thread_is_left(key: str) -> None:
    """After a run only the threads that were there before are there."""
    before = set(threading.enumerate())
    Pipeline.parse(f"videotestsrc num-buffers=3 ! zenohsink key={key}").run(timeout_s=20)
    assert set(threading.enumerate()) <= before


def _asked(session: zenoh.Session, expression: str, limit_s: float = 10.0) -> dict[str, zenoh.Sample]:
    """The publishers' replies by key; queried until there is one."""
    deadline_s, never = time.monotonic() + limit_s, threading.Event()
    while time.monotonic() < deadline_s:
        replies = [reply.ok for reply in session.get(expression, timeout=2.0)]
        if replies:
            return {str(sample.key_expr): sample for sample in replies if sample is not None}
        never.wait(0.05)
    return {}


@pytest.mark.parametrize("encoding", ["json", "msgpack", "cbor", "protobuf"])
def test_queries_are_answered_with_the_last_messages(
    open_test_session: Opener, key: str, endpoint: str, encoding: str
) -> None:
    """Record, targets, status and schemas, with their encoding and numbers."""
    with Harness("zenohsink", key=key, listen=endpoint, encoding=encoding) as harness:
        for seq in range(3):
            harness.push(_frame(seq).attach(_many_tracks(2)))
        found = _asked(open_test_session(connect=endpoint), f"{key}/**")
    keys = {"tracks", "track/0", "track/1", "status", "schema", "schema/streamkit.proto"}
    assert {f"{key}/{name}" for name in keys} <= set(found)
    codec = Codec(TrackRecord, "streamkit.tracks/1", Encoding(encoding))
    whole, one = found[f"{key}/tracks"], found[f"{key}/track/1"]
    assert str(whole.encoding) == f"application/{encoding};streamkit.tracks/1"
    assert [track.id for track in codec.decode(whole.payload.to_bytes()).tracks] == [0, 1]
    assert [track.id for track in codec.decode(one.payload.to_bytes()).tracks] == [1]
    stamp, _ = read_attachment(whole.attachment.to_bytes())
    assert stamp is not None
    assert stamp.number == 2
    status = Codec(StatusRecord, "streamkit.status/1", Encoding(encoding)).decode(
        found[f"{key}/status"].payload.to_bytes()
    )
    assert (status.state, status.frames, status.seq, status.source) == ("playing", 3, 2, key)


def test_the_status_has_the_work_and_the_drops_of_each_element(
    open_test_session: Opener, key: str, endpoint: str
) -> None:
    """As the statistics of the pipeline; a queue does no work, whatever upstream waits for it."""
    text = (
        "videotestsrc is-live=true ! valve name=shut drop=true ! fakesink "
        "videotestsrc is-live=true ! queue name=q ! identity name=slow sleep-time=2000 "
        f"! zenohsink key={key} listen={endpoint}"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        wait, session = threading.Event(), open_test_session(connect=endpoint)
        for _ in range(600):
            sample = _asked(session, f"{key}/status")[f"{key}/status"]
            status = Codec(StatusRecord, "streamkit.status/1", Encoding("json")).decode(
                sample.payload.to_bytes()
            )
            found = {element.name: element for element in status.elements}
            if status.frames > 5 and found["shut"].drops:
                break
            wait.wait(0.05)
        rows = {row.element: row for row in pipeline.statistics()}
    assert list(found) == list(rows)
    assert 5 * 2_000_000 < found["slow"].busy_ns <= rows["slow"].busy_ns
    assert found["q"].busy_ns == 0
    ((reason, count),) = rows["shut"].dropped.items()
    assert found["shut"].drops[0].reason == reason
    assert 0 < found["shut"].drops[0].count <= count


def test_status_comes_once_a_second_and_at_the_end(
    open_test_session: Opener, key: str, endpoint: str
) -> None:
    """State, counters and age; the last one has the state `ended` and the last number."""
    subscriber = _Subscriber(open_test_session(listen=endpoint), f"{key}/status", 3)
    with Harness("zenohsink", key=key, connect=endpoint) as harness:
        harness.push(_frame(0, Capture(time.time_ns() - 10**9, "rtcp")))
        wait = threading.Event()
        for seq in range(1, 500):
            if len(subscriber.samples) >= 2:
                break
            harness.push(_frame(seq))
            wait.wait(0.01)
        harness.drain()
    assert subscriber.enough.wait(10)
    found = [json.loads(sample.payload.to_bytes()) for sample in subscriber.samples]
    assert found[-1]["state"] == "ended"
    assert {status["state"] for status in found[:-1]} == {"playing"}
    times = [status["published_ns"] for status in found]
    assert 0.8e9 < times[1] - times[0] < 3e9
    tracks = found[-1]["streams"][0]
    assert tracks["name"] == "tracks"
    assert tracks["settled_number"] == found[-1]["frames"] > 1


def test_streams_can_be_switched_off(open_test_session: Opener, key: str, endpoint: str) -> None:
    """A disabled stream is neither published nor sent in replies."""
    with Harness("zenohsink", key=key, listen=endpoint, tracks=False, track=False, status=False) as harness:
        subscriber = _Subscriber(open_test_session(connect=endpoint), f"{key}/**", 1)
        harness.push(_frame(0).attach(_many_tracks(2)))
        found = _asked(open_test_session(connect=endpoint), f"{key}/**")
        harness.push(_frame(1).attach(_many_tracks(2)))
        harness.drain()
    assert {name.split("/")[2] for name in found} == {"schema"}
    assert not subscriber.samples


def test_frames_are_published_at_their_rate(open_test_session: Opener, key: str, endpoint: str) -> None:
    """30 frames/s at a rate of 10 are every third one, scaled, with their header."""
    subscriber = _Subscriber(open_test_session(listen=endpoint), f"{key}/frame", 4)
    text = (
        "videotestsrc num-buffers=12 ! video/x-raw, format=GRAY8, width=64, height=48, framerate=30/1 "
        f"! zenohsink name=z key={key} connect={endpoint} sync=true frame-rate=10 frame-width=32"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.ready()
        assert wait_for(lambda: pipeline["z"]._publication.media["frame"].has_subscriber)
        pipeline.play()
        assert pipeline.wait(20) is not None
    assert subscriber.enough.wait(10)
    headers = [json.loads(sample.attachment.to_bytes().partition(b"\n")[2]) for sample in subscriber.samples]
    assert [header["record"]["seq"] for header in headers] == [0, 3, 6, 9]
    assert {(header["record"]["width"], header["picture_width"]) for header in headers} == {(64, 32)}
    assert [str(sample.encoding) for sample in subscriber.samples] == ["image/jpeg;streamkit.frame/1"] * 4
    images = [cv2.imdecode(np.frombuffer(s.payload.to_bytes(), np.uint8), 0) for s in subscriber.samples]
    assert [image.shape for image in images] == [(24, 32)] * 4


def test_images_that_wait_at_the_end_are_counted(
    open_test_session: Opener, key: str, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of four frames one is being sent, the newest waits, and two were replaced."""
    working, released = threading.Event(), threading.Event()

    def encode_slowly(*_: object) -> tuple[bytes, bytes]:
        working.set()
        released.wait(20)
        return b"", b""

    monkeypatch.setattr(FrameSender, "encoded", encode_slowly)
    _subscriber = _Subscriber(open_test_session(listen=endpoint), f"{key}/frame", 1)
    with Harness("zenohsink", key=key, connect=endpoint) as harness:
        assert wait_for(lambda: harness.element._publication.media["frame"].has_subscriber)
        harness.push(_frame(0), "frame")
        assert working.wait(10)
        for number in range(1, 4):
            harness.push(_frame(number), "frame")
        harness.element.stop()
        released.set()
        drops = dict(harness.element.drops)
    assert drops == {"frame: replaced by a newer one": 2, "frame: not sent before the end": 1}


def test_frames_of_the_frame_pad_are_published(open_test_session: Opener, key: str, endpoint: str) -> None:
    """They may differ from those of the pad `sink`, for example with tracks drawn on them."""
    subscriber = _Subscriber(open_test_session(listen=endpoint), f"{key}/frame", 1)
    with Harness("zenohsink", key=key, connect=endpoint, frame_format="png") as harness:
        assert wait_for(lambda: harness.element._publication.media["frame"].has_subscriber)
        harness.push(_frame(5).replace(data=np.full((2, 4), 77, np.uint8)), "frame")
        assert subscriber.enough.wait(10)
        harness.drain()
    image = cv2.imdecode(np.frombuffer(subscriber.samples[0].payload.to_bytes(), np.uint8), 0)
    assert (image == 77).all()


def test_the_mosaic_pad_publishes_changes(open_test_session: Opener, key: str, endpoint: str) -> None:
    """One with the pixels of the last at the same place is not sent; EOS follows that of both pads."""
    subscriber = _Subscriber(open_test_session(listen=endpoint), f"{key}/mosaic", 3)
    text = (
        f"zenohsink name=z key={key} connect={endpoint} mosaic-format=png "
        "appsrc name=main caps=video/x-raw,format=GRAY8,width=8,height=8 ! z. "
        "appsrc name=ground caps=video/x-raw,format=GRAY8,width=8,height=8 ! z.mosaic"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert wait_for(lambda: pipeline["z"]._publication.media["mosaic"].has_subscriber)
        for number, (level, reference) in enumerate(((10, 0), (10, 0), (10, 1), (20, 1))):
            caps = raw_video_caps("GRAY8", 8, 8, None)
            place = Registration(np.eye(3), np.eye(3), reference=reference)
            pipeline["ground"].push(Frame(np.full((8, 8), level, np.uint8), caps).attach(place))
            assert wait_for(lambda number=number: len(subscriber.samples) >= (1, 1, 2, 3)[number])
        pipeline["ground"].end()
        pipeline["main"].end()
        message = pipeline.wait(20)
        assert message is not None
        assert message.error is None
    assert subscriber.enough.wait(5)
    images = [cv2.imdecode(np.frombuffer(s.payload.to_bytes(), np.uint8), 0) for s in subscriber.samples]
    assert [int(image[0, 0]) for image in images] == [10, 10, 20]


def test_a_track_with_nan_ends_the_stream(open_test_session: Opener, key: str, endpoint: str) -> None:
    """The record is made in another thread; its error ends the pipeline at the next frame."""
    subscriber = _Subscriber(open_test_session(listen=endpoint), f"{key}/tracks", 1)
    with Harness("zenohsink", key=key, connect=endpoint, wait_subscribers=1) as harness:
        covariance = np.eye(2)
        bad = Track(
            31, TrackState.CONFIRMED, float("nan"), 2.5, 3.0, 4.0, 0.1, (1.0, 2.0), covariance, 0.5, 7
        )
        harness.push(_frame(0).attach(Tracks((bad,))))
        with pytest.raises(ElementFailure, match=r"track 31: .* must be finite"):
            harness.drain()
    assert not subscriber.samples


@pytest.mark.parametrize(
    "property_name", ["tracks_qos", "track_qos", "frame_qos", "mosaic_qos", "status_qos"]
)
def test_a_malformed_qos_is_an_error_at_start(property_name: str, key: str) -> None:
    """Each stream's property is validated."""
    with pytest.raises(ResourceError, match="write for example drop,data-low"):
        Harness("zenohsink", key=key, **{property_name: "fast"})


def test_qos_reaches_the_subscriber(open_test_session: Opener, key: str, endpoint: str) -> None:
    """Congestion control, priority and express are those of the property."""
    subscriber = _Subscriber(open_test_session(listen=endpoint), f"{key}/tracks", 1)
    with Harness(
        "zenohsink", key=key, connect=endpoint, wait_subscribers=1, tracks_qos="drop,real-time,express"
    ) as harness:
        harness.push(_frame(0))
        assert subscriber.enough.wait(10)
        harness.drain()
    (sample,) = subscriber.samples
    assert (sample.priority, sample.congestion_control) == (
        zenoh.Priority.REAL_TIME,
        zenoh.CongestionControl.DROP,
    )
    assert sample.express
