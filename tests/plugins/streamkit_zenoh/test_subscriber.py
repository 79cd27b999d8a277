"""TrackSubscriber: the newest record of every publisher, typed, and counts of all losses."""

import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import zenoh

import streamkit_zenoh
from streamkit import (
    Frame,
    Track,
    Tracks,
    TrackState,
    encode_record,
    raw_video_caps,
    track_record,
)
from streamkit.testing import Harness
from streamkit_zenoh.keys import InvalidKey, alive_key
from streamkit_zenoh.presence import is_matching
from streamkit_zenoh.subscriber import TrackSubscriber
from streamkit_zenoh.wire.encodings import Codec, Encoding
from streamkit_zenoh.wire.messages import STATUS_SCHEMA, StatusRecord, StreamStatus
from streamkit_zenoh.wire.numbering import Stamp
from tests.waiting import wait_for

Opener = Callable[..., zenoh.Session]
Feed = tuple[TrackSubscriber, zenoh.Session, zenoh.Publisher]


def _frame(seq: int, *states: TrackState) -> Frame:
    tracks = tuple(
        Track(number, state, 1.5, 2.5, 3.0, 4.0, 0.1, (1.0, 2.0), np.eye(2), 0.5, 7)
        for number, state in enumerate(states)
    )
    caps = raw_video_caps("GRAY8", 8, 4)
    return Frame(np.zeros((4, 8), np.uint8), caps, pts=seq, seq=seq, arrival_ns=1).attach(Tracks(tracks))


@pytest.fixture
def sink(key: str, endpoint: str) -> Iterator[Callable[..., Harness]]:
    """Starts a zenohsink that listens; closed after the test."""
    open_ones: list[Harness] = []

    def started(**properties: object) -> Harness:
        open_ones.append(Harness("zenohsink", key=key, listen=endpoint, **properties))
        return open_ones[-1]

    yield started
    for harness in open_ones:
        harness.close()


@pytest.fixture
def feed(open_test_session: Opener, key: str, endpoint: str) -> Iterator[Feed]:
    """A subscriber, and a session whose publisher of records it has found."""
    with TrackSubscriber(key, listen=endpoint, ring=8) as subscriber:
        session = open_test_session(connect=endpoint)
        publisher = session.declare_publisher(f"{key}/tracks")
        assert wait_for(lambda: publisher.matching_status.matching)
        yield subscriber, session, publisher


def _put_ended(session: zenoh.Session, key: str) -> None:
    """Says that a run has ended."""
    codec = Codec(StatusRecord, STATUS_SCHEMA, Encoding.JSON)
    ended = codec.encode(_status(key, settled_number=1, state="ended"))
    session.put(f"{key}/status", ended, encoding=codec.content_type)


def test_it_is_a_name_of_the_package() -> None:
    """`from streamkit_zenoh import TrackSubscriber` is what the documentation says."""
    assert streamkit_zenoh.TrackSubscriber is TrackSubscriber
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        streamkit_zenoh.Nothing  # noqa: B018


@pytest.mark.parametrize("encoding", ["json", "msgpack", "cbor", "protobuf"])
def test_records_come_in_every_encoding(
    sink: Callable[..., Harness], key: str, endpoint: str, encoding: str
) -> None:
    """Each message names its encoding; iteration ends with the publisher."""
    with TrackSubscriber(key, connect=endpoint, ring=64, ends_with_publisher=True) as subscriber:
        harness = sink(encoding=encoding, wait_subscribers=1)
        for seq in range(20):
            harness.push(_frame(seq, TrackState.CONFIRMED))
        harness.drain()
        records = list(subscriber)
    assert [record.seq for record in records] == list(range(20))
    assert records[0].tracks[0].state is TrackState.CONFIRMED
    assert (subscriber.counts.lost, subscriber.counts.bad, subscriber.counts.overwritten) == (0, 0, 0)


def test_a_slow_reader_sees_the_newest(sink: Callable[..., Harness], key: str, endpoint: str) -> None:
    """One record is held; those it replaced are counted."""
    with TrackSubscriber(key, connect=endpoint) as subscriber:
        harness = sink(wait_subscribers=1)
        for seq in range(50):
            harness.push(_frame(seq))
        assert wait_for(lambda: subscriber.counts.received == 50)
        record = subscriber.get(5)
        assert record is not None
        assert record.seq == 49
        assert subscriber.counts.overwritten == 49
        assert subscriber.get(0.0) is None


def test_the_keys_of_other_publishers_are_found(
    sink: Callable[..., Harness], key: str, endpoint: str
) -> None:
    """As for a subscriber whose key is wrong; those in reach, and none after the end."""
    harness = sink()
    with TrackSubscriber("nowhere", connect=endpoint) as subscriber:
        assert wait_for(lambda: subscriber.published_keys() == [key])
        harness.close()
        assert wait_for(lambda: subscriber.published_keys() == [])


def test_a_late_subscriber_gets_the_last_record(
    sink: Callable[..., Harness], key: str, endpoint: str
) -> None:
    """The last record arrives without a new frame, and counts as no gap."""
    harness = sink()
    for seq in range(5):
        harness.push(_frame(seq, TrackState.CONFIRMED))
    with TrackSubscriber(key, connect=endpoint) as subscriber:
        record = subscriber.get(10)
        assert record is not None
        assert (record.seq, subscriber.counts.lost, subscriber.counts.publishers) == (4, 0, 1)
    with TrackSubscriber(f"{key}/track/*", connect=endpoint) as subscriber:
        update = subscriber.update(10)
        assert update is not None
        assert update.record is not None
        assert update.key == f"{key}/track/0"


def test_the_queried_record_overtakes_no_other(sink: Callable[..., Harness], key: str, endpoint: str) -> None:
    """A subscriber that joins during publishing gets each record once, in order, and counts no loss."""
    harness = sink(max_queue=10_000, wait_subscribers=0)
    for join in range(5):
        first = join * 300
        with TrackSubscriber(key, connect=endpoint, ring=5000) as subscriber:
            for seq in range(first, first + 300):
                harness.push(_frame(seq, TrackState.CONFIRMED))
            assert wait_for(lambda: subscriber.counts.publishers == 1)
            last = first + 299
            numbers: list[int] = []
            while (not numbers or numbers[-1] < last) and (record := subscriber.get(10)) is not None:
                numbers.append(record.seq)
        assert numbers == sorted(set(numbers))
        assert numbers[-1] == last
        assert subscriber.counts.lost == 0


def test_each_target_can_be_followed_by_itself(sink: Callable[..., Harness], key: str, endpoint: str) -> None:
    """Confirmed and coasting targets have their own keys, which are deleted when they end."""
    with TrackSubscriber(f"{key}/track/*", connect=endpoint, ring=64) as subscriber:
        harness = sink(track_qos="block")
        publication = harness.element._publication
        assert wait_for(lambda: is_matching(publication.records.part_publisher))
        confirmed, tentative, lost = TrackState.CONFIRMED, TrackState.TENTATIVE, TrackState.LOST
        harness.push(_frame(0, confirmed, tentative, confirmed))
        harness.push(_frame(1, confirmed, confirmed, lost))
        harness.push(_frame(2, confirmed))
        harness.drain()
        assert wait_for(lambda: subscriber.counts.publishers == 0)
        found = []
        while (update := subscriber.update(0.2)) is not None:
            record = update.record
            found.append((int(update.key.rsplit("/", 1)[1]), None if record is None else record.seq))
            assert record is None or len(record.tracks) == 1
    assert found == [(0, 0), (2, 0), (0, 1), (1, 1), (2, None), (0, 2), (1, None), (0, None)]
    assert subscriber.counts.lost == 0


def test_drops_of_the_publisher_are_losses_of_the_receiver(
    sink: Callable[..., Harness], key: str, endpoint: str
) -> None:
    """Drops are gaps in the numbers: their count equals the losses, also at the end."""
    with TrackSubscriber(key, connect=endpoint, ring=5000, ends_with_publisher=True) as subscriber:
        harness = sink(wait_subscribers=1, max_queue=2)
        harness.push(_frame(0))
        assert wait_for(lambda: subscriber.counts.received == 1)
        for seq in range(1, 2000):
            harness.push(_frame(seq))
        harness.drain()
        received = len(list(subscriber))
    dropped = harness.element.drops["tracks: queue full"]
    assert dropped > 0
    assert (received, subscriber.counts.lost) == (2000 - dropped, dropped)


def test_bad_data_is_counted(open_test_session: Opener, key: str, endpoint: str) -> None:
    """Neither an invalid nor a too large message ends the iteration."""
    with TrackSubscriber(key, listen=endpoint, ring=64) as subscriber:
        session = open_test_session(connect=endpoint)
        publisher = session.declare_publisher(
            f"{key}/tracks", congestion_control=zenoh.CongestionControl.BLOCK
        )
        assert wait_for(lambda: publisher.matching_status.matching)
        for data in (b"", b"{}", bytes(5_000_000)):
            publisher.put(data)
        publisher.put(b"<x/>", encoding=zenoh.Encoding.APPLICATION_XML)
        publisher.put(encode_record(track_record(_frame(7), source="", published_ns=1)))
        record = subscriber.get(10)
        assert record is not None
        assert (record.seq, subscriber.counts.bad) == (7, 4)


def _status(
    key: str, settled_number: int, first_number: int | None = None, state: str = "playing"
) -> StatusRecord:
    stream = StreamStatus(
        name="tracks", run=5, settled_number=settled_number, published=1, bytes=2, has_subscriber=1,
        first_number=first_number,
    )  # fmt: skip
    return StatusRecord(
        schema=STATUS_SCHEMA, source=key, state=state, run=5, published_ns=1, uptime_s=1.0,
        frames=4, tracks=0, streams=(stream,), drops=(),
    )  # fmt: skip


def test_the_status_shows_losses_at_the_end(open_test_session: Opener, key: str, endpoint: str) -> None:
    """The last status holds the last number: missing records count as lost without a later one."""
    codec = Codec(StatusRecord, STATUS_SCHEMA, Encoding.JSON)
    with TrackSubscriber(key, listen=endpoint, ring=8) as subscriber:
        session = open_test_session(connect=endpoint)
        publisher = session.declare_publisher(f"{key}/tracks")
        assert wait_for(lambda: publisher.matching_status.matching)
        publisher.put(b"{}", attachment=Stamp(5, 0).attachment())
        for state, lost in (("playing", 0), ("playing", 3), ("ended", 3)):
            status = _status(key, settled_number=4, state=state)
            session.put(f"{key}/status", codec.encode(status), encoding=codec.content_type)
            assert wait_for(lambda lost=lost: subscriber.counts.lost == lost)


@pytest.mark.parametrize("delay_s", [0.0, 0.02, 0.1, 0.5])
def test_a_late_status_shows_what_was_lost_before_the_first_record(
    open_test_session: Opener, key: str, endpoint: str, delay_s: float
) -> None:
    """The reply to the receiver's query may arrive long after the first record."""
    codec = Codec(StatusRecord, STATUS_SCHEMA, Encoding.JSON)
    payload = codec.encode(_status(key, settled_number=0, first_number=0))
    asked, release = threading.Event(), threading.Event()

    def answer_late(query: zenoh.Query) -> None:
        asked.set()
        release.wait(delay_s)
        with query:
            query.reply(f"{key}/status", payload, encoding=codec.content_type)

    session = open_test_session(listen=endpoint)
    session.declare_queryable(f"{key}/status", zenoh.handlers.Callback(answer_late, indirect=True))
    publisher = session.declare_publisher(f"{key}/tracks")
    with TrackSubscriber(key, connect=endpoint, ring=64) as subscriber:
        assert wait_for(lambda: publisher.matching_status.matching)
        token = session.liveliness().declare_token(alive_key(f"{key}/tracks"))
        assert asked.wait(10)
        for number in (5, 6, 9):
            publisher.put(b"{}", attachment=Stamp(5, number).attachment())
        assert wait_for(lambda: subscriber.counts.lost == 7)
        assert wait_for(lambda: subscriber.counts.received == 3)
        assert subscriber.counts.lost == 7
        token.undeclare()


def test_a_publisher_that_was_killed_before_its_first_status_has_vanished(feed: Feed, key: str) -> None:
    """The run before it had ended; its own records are of a later run."""
    subscriber, session, publisher = feed
    for run in (5, 6):
        publisher.put(b"{}", attachment=Stamp(run, 0).attachment())
        _put_ended(session, key)
    assert wait_for(lambda: subscriber.counts.received == 2)
    assert subscriber.has_vanished


def test_a_publisher_that_was_killed_before_its_first_record_has_vanished(feed: Feed, key: str) -> None:
    """The run before it had ended; of its own the token alone was there."""
    subscriber, session, publisher = feed
    _put_ended(session, key)
    publisher.put(b"{}", attachment=Stamp(5, 0).attachment())
    assert wait_for(lambda: subscriber.counts.received == 1)
    assert not subscriber.has_vanished
    token = session.liveliness().declare_token(alive_key(f"{key}/tracks"))
    assert wait_for(lambda: subscriber.counts.publishers == 1)
    token.undeclare()
    assert wait_for(lambda: subscriber.counts.publishers == 0)
    assert subscriber.has_vanished


def test_publishers_are_counted(open_test_session: Opener, key: str, endpoint: str) -> None:
    """The number of live publishers is known without any message."""
    with TrackSubscriber(key, listen=endpoint) as subscriber:
        assert subscriber.counts.publishers == 0
        session = open_test_session(connect=endpoint)
        token = session.liveliness().declare_token(alive_key(f"{key}/tracks"))
        assert wait_for(lambda: subscriber.counts.publishers == 1)
        token.undeclare()
        assert wait_for(lambda: subscriber.counts.publishers == 0)


def test_close_ends_the_iteration(key: str) -> None:
    """Another thread may close; the iterator then ends, and a second close has no effect."""
    subscriber = TrackSubscriber(key)
    ended = threading.Event()

    def read() -> None:
        list(subscriber)
        ended.set()

    reader = threading.Thread(target=read)
    reader.start()
    assert subscriber.close()
    assert ended.wait(5)
    reader.join(5)
    assert subscriber.close()


def test_a_bad_key_is_refused() -> None:
    """With an example of a valid one."""
    with pytest.raises(InvalidKey, match="for example uav/1"):
        TrackSubscriber("/uav")
