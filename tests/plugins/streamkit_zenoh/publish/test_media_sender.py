"""Coded packets at KEY/video."""

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
