"""Coded packets at KEY/video."""

import threading
from collections.abc import Callable
from pathlib import Path

import av
import zenoh

from streamkit import Pipeline, decode_record
from streamkit_zenoh.wire.encodings import decode_json
from streamkit_zenoh.wire.numbering import read_attachment
from streamkit_zenoh.wire.video_header import VideoHeader


def test_packets_are_published_unchanged_with_the_times_of_their_frames(
    key: str, tmp_path: Path, open_test_session: Callable[..., zenoh.Session]
) -> None:
    """What arrives at KEY/video decodes to the frames of the file; each record has the pts of one packet."""
    video = tmp_path / "flight.mp4"
    Pipeline.parse(f"videotestsrc num-buffers=30 ! videofilesink location={video}").run(timeout_s=30)
    packets: list[zenoh.Sample] = []
    records: list[zenoh.Sample] = []
    session = open_test_session()
    for stream, taken in (("video", packets), ("tracks", records)):
        handler = zenoh.handlers.Callback(taken.append, indirect=False)
        session.declare_subscriber(f"{key}/{stream}", handler)
    Pipeline.parse(
        f"filesrc location={video} ! tee name=t ! decode ! zenohsink name=z key={key} wait-subscribers=1 "
        "t. ! queue ! z.video"
    ).run(timeout_s=30)
    pairs = [read_attachment(sample.attachment.to_bytes()) for sample in packets if sample.attachment]
    headers = [decode_json(header, VideoHeader) for _, header in pairs]
    assert [stamp.number for stamp, _ in pairs if stamp] == list(range(30))
    assert headers[0].keyframe
    assert headers[0].codec is not None
    assert sorted(header.pts_ns or 0 for header in headers) == sorted(
        decode_record(sample.payload.to_bytes()).pts_ns or 0 for sample in records
    )
    with av.open(str(video)) as container:
        expected = [bytes(packet) for packet in container.demux(video=0) if packet.size]
    assert [sample.payload.to_bytes() for sample in packets] == expected


def test_the_first_packet_waits_for_a_receiver_that_comes_later(
    key: str, tmp_path: Path, open_test_session: Callable[..., zenoh.Session]
) -> None:
    """With wait-subscribers the pad `video` waits as records do: its first packet is the only keyframe."""
    video = tmp_path / "flight.mp4"
    Pipeline.parse(f"videotestsrc num-buffers=30 ! videofilesink location={video}").run(timeout_s=30)
    session = open_test_session()
    appeared = threading.Event()
    handler = zenoh.handlers.Callback(lambda _token: appeared.set(), indirect=False)
    session.liveliness().declare_subscriber(f"{key}/**", handler, history=True)
    packets: list[zenoh.Sample] = []
    with Pipeline.parse(
        f"videotestsrc num-buffers=1 ! zenohsink name=z key={key} wait-subscribers=1 "
        f"filesrc location={video} ! z.video"
    ) as pipeline:
        pipeline.play()
        assert appeared.wait(30), "the publisher has not appeared"
        for stream, take in (("video", packets.append), ("tracks", lambda _record: None)):
            session.declare_subscriber(f"{key}/{stream}", zenoh.handlers.Callback(take, indirect=False))
        assert pipeline.wait(30)
    stamps = [read_attachment(sample.attachment.to_bytes())[0] for sample in packets if sample.attachment]
    assert [stamp.number for stamp in stamps if stamp] == list(range(30))
