"""A receiver survives any message, and counts each one that is no record."""

from __future__ import annotations

import random
from collections.abc import Iterator

import numpy as np
import pytest
import zenoh

from streamkit import TRACKS_SCHEMA, Frame, Pipeline, Registration, Tracks, raw_video_caps, track_record
from streamkit_zenoh.configuration import SessionSettings
from streamkit_zenoh.session import close_session, open_session
from streamkit_zenoh.subscriber import TrackSubscriber
from streamkit_zenoh.wire.encodings import BadPayload, Codec, Encoding, encoding_of
from streamkit_zenoh.wire.frame_header import frame_header, read_header
from streamkit_zenoh.wire.images import ImageFormat, decode_image, encode_image
from streamkit_zenoh.wire.numbering import read_attachment
from tests.ports import free_port
from tests.waiting import wait_for

KEY = "acceptance/hostile"
COUNT = 10_000
ENCODINGS = [f"application/{form};{TRACKS_SCHEMA}" for form in Encoding] + [
    "zenoh/bytes",
    "image/jpeg",
    "x" * 200,
]


@pytest.fixture
def endpoint() -> str:
    """A free endpoint."""
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def publisher(endpoint: str) -> Iterator[zenoh.Session]:
    """An attacker's session, which listens."""
    session = open_session(SessionSettings(listen=endpoint))
    yield session
    close_session(session, 5.0)


def _frame(seq: int) -> Frame:
    frame = Frame(np.zeros((24, 32), np.uint8), raw_video_caps("GRAY8", 32, 24), pts=seq, seq=seq)
    return frame.attach(Tracks(), Registration(np.eye(3), np.eye(3)))


def _mutated(data: bytes, generator: random.Random) -> bytes:
    """Random bytes, or the data with a few of its bytes changed, cut or doubled."""
    if generator.random() < 0.2:
        return generator.randbytes(generator.randrange(400))
    changed = bytearray(data)
    for _ in range(generator.randrange(1, 8)):
        changed[generator.randrange(len(changed))] = generator.randrange(256)
    if generator.random() < 0.3:
        del changed[generator.randrange(len(changed)) :]
    if generator.random() < 0.1:
        changed += bytes(changed)
    return bytes(changed)


def _hostile_records(count: int) -> list[tuple[bytes, str, bytes]]:
    """Payload, encoding and attachment of each message."""
    from streamkit import TrackRecord

    generator = random.Random(7)
    good = {form: Codec(TrackRecord, TRACKS_SCHEMA, form) for form in Encoding}
    record = track_record(_frame(1), source="x", published_ns=2)
    samples = [codec.encode(record) for codec in good.values()]
    return [
        (
            _mutated(generator.choice(samples), generator),
            generator.choice(ENCODINGS),
            _mutated(b"1763690000171000000 120", generator),
        )
        for _ in range(count)
    ]


def _bad_among(messages: list[tuple[bytes, str, bytes]]) -> int:
    """Number of messages that are no records; those with older stamps are skipped before decoding."""
    from streamkit import TrackRecord

    codecs = {form: Codec(TrackRecord, TRACKS_SCHEMA, form) for form in Encoding}
    bad = 0
    for payload, encoding, attachment in messages:
        assert read_attachment(attachment) is not None
        form = encoding_of(encoding)
        try:
            if form is None:
                raise BadPayload(encoding)
            codecs[form].decode(payload)
        except BadPayload:
            bad += 1
    return bad


def _send(session: zenoh.Session, key: str, messages: list[tuple[bytes, str, bytes]]) -> None:
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    assert wait_for(lambda: bool(getattr(publisher.matching_status, "matching", False)))
    for payload, encoding, attachment in messages:
        publisher.put(payload, encoding=encoding, attachment=attachment)


def test_a_subscriber_survives_and_counts(publisher: zenoh.Session, endpoint: str) -> None:
    """Every message is passed on, or counted as bad or repeated; the last valid record arrives."""
    messages = _hostile_records(COUNT)
    with TrackSubscriber(KEY, connect=endpoint, ring=2 * COUNT) as subscriber:
        _send(publisher, f"{KEY}/tracks", messages)
        assert wait_for(lambda: subscriber.counts.received + subscriber.counts.repeated == COUNT)
        passed = 0
        while subscriber.get(0.2) is not None:
            passed += 1
        counts = subscriber.counts
        assert passed + counts.bad + counts.repeated == COUNT
        assert counts.bad > COUNT // 2
        good = Codec(type(track_record(_frame(1), source="x", published_ns=2)), TRACKS_SCHEMA, Encoding.JSON)
        publisher.put(f"{KEY}/tracks", good.encode(track_record(_frame(77), source="x", published_ns=2)))
        record = subscriber.get(10)
        assert record is not None
        assert record.seq == 77


def test_a_source_survives_and_counts(publisher: zenoh.Session, endpoint: str) -> None:
    """The pipeline continues; exactly the invalid messages are counted."""
    messages = [(payload, encoding, b"") for payload, encoding, _ in _hostile_records(COUNT)]
    text = f"zenohsrc name=s key={KEY} connect={endpoint} max-records=20000 ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        _send(publisher, f"{KEY}/tracks", messages)
        bad = _bad_among(messages)
        assert wait_for(lambda: pipeline["s"].drops["not a record"] == bad, 30)
        assert pipeline.error is None


def test_hostile_images_are_counted(publisher: zenoh.Session, endpoint: str) -> None:
    """Damaged images, wrong headers, and both: none crashes, each is counted."""
    generator = random.Random(3)
    header = frame_header(_frame(1), "x", 2, 0, (24, 32))
    image = encode_image(np.zeros((24, 32), np.uint8), ImageFormat.PNG)
    messages = []
    for _ in range(COUNT // 10):
        payload = _mutated(image, generator) if generator.random() < 0.7 else image
        lying = _mutated(header, generator) if generator.random() < 0.7 else header
        messages.append((payload, "image/png", b"1 1\n" + lying))
    bad = 0
    for number, (payload, encoding, attachment) in enumerate(messages):
        stamped = b"%d %d\n" % (5, number) + attachment.partition(b"\n")[2]
        messages[number] = (payload, encoding, stamped)
        try:
            said = read_header(read_attachment(stamped)[1])
            shape = decode_image(payload).shape
            if shape[:2] != (said.picture_height, said.picture_width):
                raise ValueError(shape)
        except ValueError:
            bad += 1
    text = f"zenohsrc name=s key={KEY} connect={endpoint} receive=frame ! appsink name=out drop=true"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        _send(publisher, f"{KEY}/frame", messages)
        assert wait_for(lambda: pipeline["s"].drops["not a record"] == bad, 30)
        assert pipeline.error is None
    assert bad > COUNT // 40
