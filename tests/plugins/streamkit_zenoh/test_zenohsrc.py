"""zenohsrc: frames with tracks from records, EOS when the publisher ends, invalid messages skipped."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import zenoh

from streamkit import (
    Caps,
    Detections,
    ElementFailure,
    Frame,
    MessageKind,
    Pipeline,
    Registration,
    ResourceError,
    Track,
    TrackRecord,
    Tracks,
    TrackState,
    decode_record,
    encode_record,
    luma,
    track_record,
)
from streamkit.testing import Harness
from streamkit_zenoh import silence
from streamkit_zenoh.keys import alive_key
from streamkit_zenoh.session import close_session
from streamkit_zenoh.wire.encodings import Codec, Encoding
from streamkit_zenoh.wire.numbering import Stamp

Opener = Callable[..., zenoh.Session]


def _payload(seq: int, epoch: int = 0) -> bytes:
    track = Track(4, TrackState.CONFIRMED, 1.0, 2.0, 3.0, 4.0, 0.5, (6.0, 7.0), np.eye(2), 0.5, 9)
    frame = Frame(b"", Caps("video/x-raw, width=64, height=48"), pts=seq * 40, seq=seq, epoch=epoch)
    frame = frame.attach(Tracks((track,)), Registration(np.eye(3), np.eye(3), reference=2))
    return encode_record(track_record(frame, source="test", published_ns=1))


class _Publisher:
    """A plain zenoh publisher with a token, in a session of its own."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.session = session
        self.run = time.time_ns()
        self.publisher = session.declare_publisher(
            f"{key}/tracks", congestion_control=zenoh.CongestionControl.BLOCK
        )
        self._token = session.liveliness().declare_token(alive_key(f"{key}/tracks"))

    def wait(self) -> None:
        never = threading.Event()
        for _ in range(1000):
            if self.publisher.matching_status.matching:
                return
            never.wait(0.01)
        pytest.fail("no subscriber has come within 10 s")

    def put(self, payload: bytes, number: int | None = None) -> None:
        attachment = None if number is None else Stamp(self.run, number).attachment()
        self.publisher.put(payload, attachment=attachment)

    def close(self) -> None:
        assert close_session(self.session, 5.0)


@pytest.fixture
def publisher(open_test_session: Opener, endpoint: str, key: str) -> _Publisher:
    """A publisher at `key` that listens on `endpoint`."""
    return _Publisher(open_test_session(listen=endpoint), key)


@pytest.fixture
def receive(endpoint: str, key: str) -> Iterator[Callable[..., Pipeline]]:
    """Plays `zenohsrc ! appsink` with properties; stopped after the test."""
    pipelines: list[Pipeline] = []

    def playing(properties: str = "", sink: str = "", name: str = key) -> Pipeline:
        text = f"zenohsrc name=source key={name} connect={endpoint} {properties} ! appsink name=out {sink}"
        pipelines.append(Pipeline.parse(text))
        pipelines[-1].play()
        return pipelines[-1]

    yield playing
    for pipeline in pipelines:
        pipeline.stop()


def test_records_become_frames(publisher: _Publisher, receive: Callable[..., Pipeline]) -> None:
    """Record as data, its times, tracks and registration as metadata; EOS at the publisher's end."""
    pipeline = receive()
    publisher.wait()
    for seq in range(3, 8):
        publisher.put(_payload(seq))
    publisher.close()
    frames = list(pipeline["out"])
    assert [bytes(frame.data) for frame in frames] == [_payload(seq) for seq in range(3, 8)]
    assert [(frame.seq, frame.pts) for frame in frames] == [(seq, seq * 40) for seq in range(3, 8)]
    first = frames[0]
    assert (first.caps.name, first.caps["width"], first.caps["height"]) == ("application/x-tracks", 64, 48)
    tracks, registration = first.get(Tracks), first.get(Registration)
    assert tracks is not None
    assert tracks.tracks[0].velocity == (6.0, 7.0)
    assert registration is not None
    assert registration.reference == 2


def test_num_buffers_ends_the_stream(publisher: _Publisher, receive: Callable[..., Pipeline]) -> None:
    """EOS follows so many records, whatever the publisher does."""
    pipeline = receive("num-buffers=3")
    publisher.wait()
    for seq in range(10):
        publisher.put(_payload(seq))
    assert [frame.seq for frame in pipeline["out"]] == [0, 1, 2]


def test_wildcards_receive_several_publishers(open_test_session: Opener, endpoint: str, key: str) -> None:
    """One receiver at KEY/* gets all, and ends when the last publisher is gone."""
    pipeline = Pipeline.parse(f'zenohsrc key="{key}/*" listen={endpoint} ! appsink name=out')
    with pipeline:
        pipeline.play()
        publishers = [_Publisher(open_test_session(connect=endpoint), f"{key}/{name}") for name in ("a", "b")]
        for publisher in publishers:
            publisher.wait()
        for seq, publisher in enumerate(publishers):
            publisher.put(_payload(seq))
        assert sorted(pipeline["out"].pull().seq for _ in publishers) == [0, 1]
        publishers[0].close()
        publishers[1].put(_payload(7))
        publishers[1].close()
        assert [frame.seq for frame in pipeline["out"]] == [7]


def test_publishers_with_different_times_lose_nothing(
    publisher: _Publisher, receive: Callable[..., Pipeline]
) -> None:
    """A pts before the first one's starts a new epoch: within an epoch, pts never decrease."""
    pipeline = receive()
    publisher.wait()
    for seq in (9, 10, 3, 11, 4):
        publisher.put(_payload(seq))
    publisher.close()
    assert [(frame.seq, frame.epoch) for frame in pipeline["out"]] == [
        (9, 0),
        (10, 0),
        (3, 1),
        (11, 1),
        (4, 1),
    ]


def test_bad_data_is_counted_and_skipped(publisher: _Publisher, receive: Callable[..., Pipeline]) -> None:
    """An invalid message neither ends the stream nor passes; one warning is posted."""
    pipeline = receive()
    publisher.wait()
    for data in (b"", b"{}", b"\xff" * 100, b"[" * 10_000, bytes(5 * 1024 * 1024)):
        publisher.put(data)
    publisher.put(_payload(1))
    publisher.close()
    assert [frame.seq for frame in pipeline["out"]] == [1]
    assert pipeline["source"].drops["not a record"] == 5


def test_lost_records_are_counted(publisher: _Publisher, receive: Callable[..., Pipeline]) -> None:
    """A gap in the publisher's numbers is a loss; a gap in seq alone is a frame without a record."""
    pipeline = receive()
    publisher.wait()
    for seq, number in ((0, 0), (5, 1), (6, 4), (7, 5)):
        publisher.put(_payload(seq), number)
    publisher.close()
    assert len(list(pipeline["out"])) == 4
    assert pipeline["source"].drops["lost on the way"] == 2


def test_a_forged_number_hides_no_message(publisher: _Publisher, receive: Callable[..., Pipeline]) -> None:
    """After a message with the publisher's run and the largest number all others pass, with a warning."""
    pipeline = receive()
    publisher.wait()
    for seq, number in ((0, 0), (1, 10**19 - 1), (2, 1), (3, 2)):
        publisher.put(_payload(seq), number)
    publisher.close()
    assert [frame.seq for frame in pipeline["out"]] == [0, 1, 2, 3]
    assert pipeline["source"].drops["lost on the way"] == 0
    warning = pipeline.bus.pop(5, (MessageKind.WARNING,))
    assert warning is not None
    assert "message numbers jump by more than ten million" in warning.text


def test_a_new_publisher_is_a_new_epoch(
    publisher: _Publisher,
    receive: Callable[..., Pipeline],
    open_test_session: Opener,
    endpoint: str,
    key: str,
) -> None:
    """With eos-on-disconnect=false the stream continues; the next publisher has a new epoch."""
    pipeline = receive("eos-on-disconnect=false")
    publisher.wait()
    for number in range(3):
        publisher.put(_payload(number, epoch=number), number)
    assert [pipeline["out"].pull(10).epoch for _ in range(3)] == [0, 1, 2]
    publisher.close()
    second = _Publisher(open_test_session(listen=endpoint), key)
    second.wait()
    for number in range(2):
        second.put(_payload(number), number)
    frames = [pipeline["out"].pull(10) for _ in range(2)]
    assert [(frame.seq, frame.epoch) for frame in frames] == [(0, 3), (1, 3)]


def test_newest_drops_the_oldest(publisher: _Publisher, receive: Callable[..., Pipeline]) -> None:
    """With `newest`, a slow reader gets the last records, and the others are counted."""
    pipeline = receive("newest=true max-records=4", "max-buffers=1")
    publisher.wait()
    for number in range(200):
        publisher.put(_payload(number), number)
    publisher.close()
    seen = [frame.seq for frame in pipeline["out"]]
    assert seen[-4:] == [196, 197, 198, 199]
    assert seen == sorted(seen)
    assert len(seen) + pipeline["source"].drops["downstream too slow"] == 200


def test_without_newest_the_publisher_is_blocked(
    publisher: _Publisher, receive: Callable[..., Pipeline]
) -> None:
    """Without `newest`, small queues lose nothing."""
    pipeline = receive("max-records=2", "max-buffers=1")
    publisher.wait()
    putter = threading.Thread(target=lambda: [publisher.put(_payload(seq), seq) for seq in range(2000)])
    putter.start()
    seen = [pipeline["out"].pull(10).seq for _ in range(2000)]
    putter.join(10)
    assert seen == list(range(2000))
    assert pipeline["source"].drops.total() == 0


def test_a_timeout_is_an_error(receive: Callable[..., Pipeline], key: str) -> None:
    """With timeout-s, the error names the key and a remedy."""
    pipeline = receive("timeout-s=0.3")
    with pytest.raises(ElementFailure, match=f"no record at {key}/tracks for 0.3 s; start the publisher"):
        list(pipeline["out"])


def test_silence_is_noted(
    monkeypatch: pytest.MonkeyPatch, publisher: _Publisher, receive: Callable[..., Pipeline]
) -> None:
    """A wait is no fault, but says what it is for: of a publisher that is there, and of other keys."""
    monkeypatch.setattr(silence, "SILENCE_S", 0.2)
    pipeline = receive()
    publisher.wait()
    message = pipeline.bus.pop(10, (MessageKind.ELEMENT,))
    assert message is not None
    assert message.fields["name"] == "note"
    assert "for 0.2 s, though a publisher is there" in str(message.fields["text"])


def test_a_wait_without_publisher_is_noted(
    monkeypatch: pytest.MonkeyPatch, receive: Callable[..., Pipeline], key: str
) -> None:
    """A misspelt key, or a publisher out of reach, would else look like a feed without targets."""
    monkeypatch.setattr(silence, "SILENCE_S", 0.2)
    message = receive().bus.pop(10, (MessageKind.ELEMENT,))
    assert message is not None
    assert message.fields["text"] == f"no record at {key}/tracks for 0.2 s, no publisher is there"


def test_a_killed_publisher_ends_the_stream(key: str, endpoint: str) -> None:
    """The token ends with its process: the receiver gets EOS."""
    script = Path(__file__).with_name("endless_publisher.py")
    with Pipeline.parse(f"zenohsrc key={key} listen={endpoint} ! appsink name=out drop=true") as pipeline:
        pipeline.play()
        process = subprocess.Popen([sys.executable, str(script), key, endpoint])
        try:
            assert pipeline["out"].pull(30) is not None
        finally:
            process.kill()
            process.wait(10)
        message = pipeline.wait(20)
        assert message is not None
        assert message.error is None


def test_a_wait_for_publishers_can_be_stopped(key: str) -> None:
    """A source without publisher stops at once, and ends with EOS on request."""
    with Pipeline.parse(f"zenohsrc key={key} ! fakesink") as pipeline:
        pipeline.play()
        pipeline.finish()
        message = pipeline.wait(10)
        assert message is not None
        assert message.error is None
    with Pipeline.parse(f"zenohsrc key={key} ! fakesink") as pipeline:
        pipeline.play()


def test_a_bad_key_is_an_error_at_start() -> None:
    """The error has an example of a valid key."""
    with pytest.raises((ResourceError, ElementFailure), match="for example uav/1"):
        Pipeline.parse("zenohsrc key=/uav ! fakesink").run(timeout_s=5)


def test_no_thread_is_left(publisher: _Publisher, receive: Callable[..., Pipeline]) -> None:
    """After a run only the threads that were there before are there."""
    before = set(threading.enumerate())
    pipeline = receive("num-buffers=1")
    publisher.wait()
    publisher.put(_payload(0))
    assert len(list(pipeline["out"])) == 1
    pipeline.stop()
    assert set(threading.enumerate()) <= before


@pytest.mark.parametrize("encoding", ["msgpack", "cbor", "protobuf"])
def test_other_encodings_become_json(
    open_test_session: Opener, key: str, endpoint: str, encoding: str
) -> None:
    """Downstream of zenohsrc a record is a line of JSON, whatever its encoding was."""
    record = decode_record(_payload(3))
    codec = Codec(TrackRecord, "streamkit.tracks/1", Encoding(encoding))
    with Pipeline.parse(f"zenohsrc key={key} listen={endpoint} num-buffers=1 ! appsink name=out") as pipeline:
        pipeline.play()
        publisher = _Publisher(open_test_session(connect=endpoint), key)
        publisher.wait()
        publisher.publisher.put(codec.encode(record), encoding=codec.content_type)
        (frame,) = pipeline["out"]
    assert bytes(frame.data) == _payload(3)


def test_last_starts_with_the_last_record(key: str, endpoint: str) -> None:
    """With last=true a late source starts with the publisher's last record."""
    with Harness("zenohsink", key=key, listen=endpoint) as sink:
        caps = Caps("video/x-raw, format=GRAY8, width=8, height=8")
        for seq in range(3):
            sink.push(Frame(np.zeros((8, 8), np.uint8), caps, seq=seq, arrival_ns=1))
        text = f"zenohsrc key={key} connect={endpoint} last=true num-buffers=1 ! appsink name=out"
        with Pipeline.parse(text) as pipeline:
            pipeline.play()
            assert [frame.seq for frame in pipeline["out"]] == [2]


def test_a_pipeline_can_be_split_over_two_machines(key: str, endpoint: str) -> None:
    """The other side gets frames, detections and registration exactly."""
    source = Pipeline.parse(f"zenohsrc name=s key={key} listen={endpoint} receive=frame ! appsink name=out")
    text = (
        "dronetestsrc num-buffers=12 seed=1 ! video/x-raw, width=320, height=240 ! stitch ! framediff "
        f"! tee name=t ! queue ! zenohsink name=z key={key} connect={endpoint} frame-rate=1000 frame-width=0 "
        "frame-format=png frame-qos=block wait-subscribers=0 sync=true t. ! queue ! appsink name=here"
    )
    with source, Pipeline.parse(text) as drone:
        source.play()
        drone.ready()
        never = threading.Event()
        for _ in range(1000):
            if drone["z"]._publication.media["frame"].has_subscriber:
                break
            never.wait(0.01)
        drone.play()
        here = {frame.seq: frame for frame in drone["here"]}
        assert drone.wait(30) is not None
        there = list(source["out"])
    assert len(there) + source["s"].drops["lost on the way"] == 12
    assert len(there) >= 6
    for frame in there:
        sent = here[frame.seq]
        np.testing.assert_array_equal(frame.data[:240], luma(sent))
        assert frame.pts == sent.pts
        ours, theirs = frame.get(Registration), sent.get(Registration)
        assert ours is not None
        assert theirs is not None
        np.testing.assert_allclose(ours.to_previous, theirs.to_previous)
        np.testing.assert_allclose(ours.to_reference, theirs.to_reference)
        found, given = frame.get(Detections), sent.get(Detections)
        assert found is not None
        assert given is not None
        np.testing.assert_array_equal(found.boxes, given.boxes)
