"""Packets are read back by a parser of the tests' own, by klvdata and by FFmpeg."""

import math
from pathlib import Path

import av
import numpy as np
import pytest

from streamkit import Capture, Frame, MessageKind, Pipeline, Pose, Track, Tracks, TrackState, raw_video_caps
from streamkit.testing import Harness
from streamkit_telemetry_formats.klv import KlvReader
from streamkit_telemetry_formats.misb import MisbTelemetry

UTC_NS = 1_700_000_000_123_456_789
WIDTH, HEIGHT = 640, 480


def read_ber(data: bytes, at: int) -> tuple[int, int]:
    """A BER length and where what it counts begins (SMPTE ST 336)."""
    if data[at] < 128:
        return data[at], at + 1
    count = data[at] - 128
    return int.from_bytes(data[at + 1 : at + 1 + count], "big"), at + 1 + count


def read_oid(data: bytes, at: int) -> tuple[int, int]:
    """A BER-OID number and where it ends (MISB ST 0107)."""
    number = 0
    while True:
        number = number * 128 + data[at] % 128
        at += 1
        if data[at - 1] < 128:
            return number, at


def read_set(data: bytes) -> list[tuple[int, bytes]]:
    """The elements of a local set, in order."""
    at, found = 0, []
    while at < len(data):
        tag, at = read_oid(data, at)
        size, at = read_ber(data, at)
        assert at + size <= len(data)
        found.append((tag, data[at : at + size]))
        at += size
    return found


def read_series(data: bytes) -> list[bytes]:
    """The packs of a series: each has its length before it (MISB ST 0107)."""
    at, found = 0, []
    while at < len(data):
        size, at = read_ber(data, at)
        assert at + size <= len(data)
        found.append(data[at : at + size])
        at += size
    return found


def numbers(elements: list[tuple[int, bytes]]) -> dict[int, int]:
    """The values of elements as unsigned integers."""
    return {tag: int.from_bytes(value, "big") for tag, value in elements}


def read_packet(data: bytes) -> list[tuple[int, bytes]]:
    """The elements of a UAS local set whose checksum is right (MISB ST 0601)."""
    assert data[:16].hex() == "060e2b34020b01010e01030101000000"
    size, at = read_ber(data, 16)
    assert at + size == len(data)
    total = 0
    for place, byte in enumerate(data[:-2]):
        total += byte << 8 * ((place + 1) % 2)
    assert total % 65536 == int.from_bytes(data[-2:], "big")
    return read_set(data[at:])


def read_vmti(data: bytes) -> tuple[dict[int, int], list[tuple[int, dict[int, int], dict[int, int]]]]:
    """Numbers of the VMTI local set; of each VTarget its id, its numbers and those of its VTracker set."""
    elements = read_set(data)
    assert [tag for tag, _ in elements] == sorted({tag for tag, _ in elements})
    targets = []
    for pack in read_series(dict(elements).get(101, b"")):
        number, at = read_oid(pack, 0)
        items = read_set(pack[at:])
        targets.append((number, numbers(items), numbers(read_set(dict(items)[104]))))
    return numbers(elements), targets


def track(number: int, state: TrackState = TrackState.CONFIRMED, **changes: float) -> Track:
    """A track of 20 x 10 px around (100, 50), seen for two seconds."""
    values = {"x": 100.0, "y": 50.0, "length": 20.0, "width": 10.0, "angle": 0.0, "score": 0.87, **changes}
    return Track(
        id=number, state=state, velocity=(1.0, 2.0), covariance=np.eye(2), age_ns=2_000_000_000, **values
    )  # fmt: skip


def frame_of(*tracks: Track, pts: int = 40_000_000) -> Frame:
    """A frame with tracks and a UTC time."""
    caps = raw_video_caps("GRAY8", WIDTH, HEIGHT)
    frame = Frame(np.zeros((HEIGHT, WIDTH), np.uint8), caps, pts=pts, capture=Capture(UTC_NS, "misb"))
    return frame.attach(Tracks(tracks))


def packet_of(frame: Frame) -> list[tuple[int, bytes]]:
    """The elements that the element writes for a frame."""
    with Harness("vmtiencode") as harness:
        (out,) = harness.push(frame)
    assert (out.caps.name, out.pts, out.metadata) == ("meta/x-klv", frame.pts, {})
    return read_packet(out.data)


def test_time_stamp_first_version_and_checksum_last() -> None:
    """The order and the elements that ST 0601 demands."""
    elements = packet_of(frame_of(track(1)))
    assert [tag for tag, _ in elements] == [2, 65, 74, 1]
    assert numbers(elements)[2] == UTC_NS // 1000


def test_targets() -> None:
    """Pixels count from 1, row by row; boxes, confidence, status and times are those of the track."""
    turned = track(300, TrackState.COASTING, angle=math.pi / 2, score=2.0)
    lost = track(70_000, TrackState.LOST)
    elements = dict(packet_of(frame_of(track(1), turned, lost, track(9, TrackState.TENTATIVE))))
    head, targets = read_vmti(elements[74])
    assert {tag: head[tag] for tag in (4, 5, 6, 8, 9)} == {4: 4, 5: 3, 6: 3, 8: WIDTH, 9: HEIGHT}
    assert [number for number, _, _ in targets] == [1, 300, 70_000]
    assert targets[0][1] == {
        1: 50 * WIDTH + 101,
        2: 45 * WIDTH + 91,
        3: 55 * WIDTH + 111,
        5: 87,
        19: 51,
        20: 101,
        104: targets[0][1][104],
    }
    assert (targets[1][1][2], targets[1][1][3]) == (40 * WIDTH + 96, 60 * WIDTH + 106)
    assert targets[1][1][5] == 100
    now_us = UTC_NS // 1000
    assert [tracker for _, _, tracker in targets] == [
        {2: 1, 3: now_us - 2_000_000, 4: now_us},
        {2: 4, 3: now_us - 2_000_000},
        {2: 2, 3: now_us - 2_000_000},
    ]


def test_targets_at_the_edge() -> None:
    """A box is cut at the frame; a centre outside is left out, as is a target wholly outside or unknown."""
    across = track(1, x=-4.0)
    beyond, unknown = track(2, x=-40.0), track(3, x=math.nan)
    head, targets = read_vmti(dict(packet_of(frame_of(across, beyond, unknown)))[74])
    assert (head[5], head[6]) == (3, 1)
    (number, items, _) = targets[0]
    assert number == 1
    assert (items[2], items[3]) == (45 * WIDTH + 1, 55 * WIDTH + 7)
    assert not items.keys() & {1, 19, 20}


def test_a_crowd_is_culled_to_one_packet() -> None:
    """Of 3000 targets those of the highest confidence are reported, and all are counted."""
    crowd = [track(n, score=n / 3000) for n in range(3000)]
    (elements,) = [dict(packet_of(frame_of(*crowd)))]
    head, targets = read_vmti(elements[74])
    assert (head[5], head[6], len(targets)) == (3000, 1000, 1000)
    assert min(number for number, _, _ in targets) == 2000
    assert len(elements[74]) < 1 << 16


def test_a_frame_without_targets_says_so() -> None:
    """Without targets a packet reports zero."""
    head, targets = read_vmti(dict(packet_of(frame_of()))[74])
    assert (head[5], head[6], targets) == (0, 0, [])


def test_the_pose_comes_back() -> None:
    """What the platform's tags hold is read as it was, to the resolution of the tags."""
    corners = ((34.71, -118.21), (34.71, -118.19), (34.69, -118.19), (34.69, -118.21))
    pose = Pose(
        34.7, -118.2, 1500.0, 1.5, math.radians(25), math.radians(-10), (0.5, -0.7, 6.0), (0.4, 0.3), "misb",
        frame_centre=(34.701, -118.201, None), corners=corners,
    )  # fmt: skip
    with Harness("vmtiencode") as harness:
        (out,) = harness.push(frame_of(track(1)).attach(pose))
    (sample,) = MisbTelemetry().feed(out.data, 0)
    assert (sample.latitude, sample.longitude) == pytest.approx((34.7, -118.2), abs=1e-7)
    assert sample.altitude == pytest.approx(1500, abs=0.2)
    assert (sample.heading, sample.pitch, sample.roll) == pytest.approx(
        (1.5, pose.pitch, pose.roll), abs=1e-4
    )
    assert sample.sensor_angles == pytest.approx(pose.sensor_angles, abs=1e-8)
    assert sample.field_of_view == pytest.approx(pose.field_of_view, abs=1e-4)
    assert sample.frame_centre is not None
    assert sample.frame_centre[:2] == pytest.approx((34.701, -118.201), abs=1e-7)
    assert np.allclose(sample.corners, corners, atol=1e-7)
    assert (sample.utc_ns, sample.source) == (UTC_NS // 1000 * 1000, "misb")


def test_a_stale_pose_is_left_out() -> None:
    """A position of another moment is none."""
    stale = Pose(1.0, 2.0, is_stale=True)
    assert 13 not in dict(packet_of(frame_of(track(1)).attach(stale)))


def test_without_a_clock_the_time_counts_from_1970_and_is_warned_about() -> None:
    """The time stamp is the time in the stream; targets have no times then."""
    with Harness("vmtiencode") as harness:
        frames = [harness.push(frame_of(track(1), pts=pts).replace(capture=None))[0] for pts in (5000, 9000)]
        warnings = [m.text for m in harness.messages if m.kind is MessageKind.WARNING]
    elements = [dict(read_packet(frame.data)) for frame in frames]
    assert [int.from_bytes(found[2], "big") for found in elements] == [5, 9]
    assert read_vmti(elements[0][74])[1][0][2] == {2: 1}
    assert warnings == ["the frames have no time of capture: the packets' time stamps count from 1970"]


def test_frames_that_no_tracker_has_seen_give_nothing() -> None:
    """They are counted, and one warning has the remedy."""
    frame = frame_of().replace(metadata={})
    with Harness("vmtiencode") as harness:
        assert harness.push(frame) + harness.push(frame) == []
        warnings = [m.text for m in harness.messages if m.kind is MessageKind.WARNING]
    assert warnings == ["no tracks come with the frames: put particletrack upstream"]


def test_an_independent_decoder_reads_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Klvdata finds the time stamp, the place and a set of 74 in each of the packets."""
    klvdata = pytest.importorskip("klvdata", reason="klvdata, the independent decoder, is not installed")
    # Its own class for tag 74 is abstract and cannot be made; without it the tag is bytes.
    monkeypatch.delitem(klvdata.misb0601.UASLocalMetadataSet.parsers, b"\x4a")
    with Harness("vmtiencode") as harness:
        pose = Pose(34.7, -118.2, source="misb above sea level", altitude=1500.0)
        data = b"".join(out.data for n in range(3) for out in harness.push(frame_of(track(n)).attach(pose)))
    packets = list(klvdata.StreamParser(data))
    assert len(packets) == 3
    for packet in packets:
        items = {int.from_bytes(key, "big"): item for key, item in packet.items.items()}
        assert items[2].value.value.timestamp() == pytest.approx(UTC_NS / 1e9, abs=1e-3)
        assert float(items[13].value.value) == pytest.approx(34.7, abs=1e-6)
        assert float(items[14].value.value) == pytest.approx(-118.2, abs=1e-6)
        assert float(items[15].value.value) == pytest.approx(1500, abs=0.2)
        assert 74 in items


def test_tracks_are_recorded_beside_the_video(tmp_path: Path) -> None:
    """The recording has the video untouched and a KLV stream with a packet for each tracked frame."""
    path = tmp_path / "tracked.ts"
    text = (
        "dronetestsrc num-buffers=30 ! video/x-raw,width=320,height=240 ! tee name=t "
        f"t. ! queue ! encode ! packetsink name=p location={path} "
        "t. ! queue ! stitch ! framediff ! particletrack min-travel=0 birth-hits=1 ! vmtiencode ! p.klv"
    )
    Pipeline.parse(text).run(timeout_s=60)
    with av.open(str(path)) as container:
        assert [stream.name for stream in container.streams] == ["h264", "klv"]
        video, klv = container.streams.video[0], container.streams.data[0]
        packets = [
            (p.stream.type, p.pts * p.time_base, bytes(p)) for p in container.demux(video, klv) if p.size
        ]
    video_frames = {round(time, 4) for kind, time, _ in packets if kind == "video"}
    assert len(video_frames) == 30
    written = [(time, data) for kind, time, data in packets if kind == "data"]
    assert len(written) >= 28
    assert all(min(abs(time - other) for other in video_frames) < 0.001 for time, _ in written)
    reader = KlvReader()
    assert len(reader.feed(b"".join(data for _, data in written))) == len(written)
    assert (reader.bad, reader.skipped) == (0, 0)
    reported = [read_vmti(dict(read_packet(data))[74]) for _, data in written]
    assert all(head[8] == 320 and head[9] == 240 for head, _ in reported)
    assert any(targets for _, targets in reported)
