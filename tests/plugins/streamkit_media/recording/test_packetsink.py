import signal
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest

from streamkit import (
    Caps,
    DescriptionError,
    ElementFailure,
    Frame,
    FrameFlags,
    Message,
    MessageKind,
    Pipeline,
    ResourceError,
)
from streamkit.testing import Harness
from streamkit_media.encoding.encoder import Codec
from streamkit_media.nalunits import units
from streamkit_telemetry_formats.klv import KlvReader

MakeVideo = Callable[..., Path]


def packets(path: Path) -> list[tuple[int, bytes]]:
    """Times (ns) and decoded-independent content of a file's video packets."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        first = stream.start_time or 0
        return [
            (round((packet.pts - first) * stream.time_base * 10**9), bytes(packet))
            for packet in container.demux(stream)
            if packet.size
        ]


def video_frames(path: Path) -> list[bytes]:
    """The luma planes of a file."""
    with av.open(str(path)) as container:
        return [bytes(video_frame.planes[0]) for video_frame in container.decode(video=0)]


@pytest.mark.parametrize("name", ["copy.ts", "copy.mp4", "copy.mkv", "copy.mov"])
@pytest.mark.parametrize("codec", ["libx264", "libx265"])
def test_a_copy_holds_the_same_frames(make_video: MakeVideo, tmp_path: Path, name: str, codec: str) -> None:
    """Packets of an MP4 with B-frames, written to each container, decode to the same frames and times."""
    source, copy = make_video(f"source_{codec}.mp4", codec=codec, count=40), tmp_path / name
    Pipeline.parse(f"filesrc location={source} ! packetsink location={copy}").run(timeout_s=20)
    assert video_frames(copy) == video_frames(source)
    for (before, _), (after, _) in zip(packets(source), packets(copy), strict=True):
        assert abs(before - after) <= 1_000_000


def shown_times(paths: list[Path]) -> list[float]:
    """When the frames of files are shown, s."""
    times = []
    for path in paths:
        with av.open(str(path)) as container:
            times += [float(frame.time) for frame in container.decode(video=0) if frame.time is not None]
    return times


def reordered(begin_ns: int, count: int = 60) -> list[Frame]:
    """Coded frames at 30000/1001 Hz with B-frames, a keyframe every ten."""
    caps = Caps("video/x-raw, format=GRAY8, width=64, height=48, framerate=30000/1001")
    scene, coded = np.tile(np.arange(256, dtype=np.uint8), (48, 1)), []
    with Harness("encode", gop=10) as encoder:
        for number in range(count):
            pts = begin_ns + round(number * 1001 * 10**9 / 30000)
            coded += encoder.push(Frame(scene[:, number : number + 64].copy(), caps, pts=pts))
        coded += encoder.drain()
    assert [frame.pts for frame in coded] != sorted(frame.pts or 0 for frame in coded)
    return coded


@pytest.mark.parametrize("ending", ["ts", "m2ts", "mp4", "mov", "mkv"])
@pytest.mark.parametrize("begin_ns", [0, 2_167_000_000, 3600 * 10**9])
@pytest.mark.parametrize("limit", ["", "max-size-time=500000000", "max-size-bytes=500"])
def test_frames_keep_the_times_of_the_stream(tmp_path: Path, ending: str, begin_ns: int, limit: str) -> None:
    """In every container and segment, so that records of the stream are matched with the frames."""
    frames = reordered(begin_ns)
    recorded(tmp_path / f"part-%02d.{ending}", frames, limit)
    parts = sorted(tmp_path.iterdir())
    assert len(parts) > 2 or not limit
    found = shown_times(parts)
    assert found == pytest.approx(sorted((frame.pts or 0) / 1e9 for frame in frames), abs=0.0006, rel=0)


@pytest.mark.parametrize("ending", ["ts", "mp4", "mkv"])
def test_a_copy_of_a_copy_keeps_its_times(tmp_path: Path, ending: str) -> None:
    """Also of Matroska, which has no decoding times, and from a keyframe in the middle on."""
    first, second = tmp_path / f"first.{ending}", tmp_path / f"second.{ending}"
    recorded(first, reordered(10**9))
    for start, least in (("", 60), ("start-s=0.5", 40)):
        text = f"filesrc location={first} {start} ! packetsink location={second} if-exists=replace"
        Pipeline.parse(text).run(timeout_s=20)
        found = shown_times([second])
        assert len(found) >= least
        assert found == pytest.approx(shown_times([first])[-len(found) :], abs=1e-4, rel=0)


def test_times_below_zero_begin_at_zero(tmp_path: Path) -> None:
    """No container holds them: all are moved alike, with a warning, as records of the stream do not match."""
    _, (warning,) = recorded(tmp_path / "x.mp4", reordered(-(10**9)))
    assert "times are 1.000 s later than in the stream" in warning
    assert shown_times([tmp_path / "x.mp4"])[::59] == pytest.approx([0, 59 * 1001 / 30000], abs=1e-4)


def test_a_copy_without_its_orientation_is_warned_of(turned_video: Path, tmp_path: Path) -> None:
    """Frames of a camera held upright: a player shows the copy on its side."""
    copy = tmp_path / "copy.mp4"
    messages: list[Message] = []
    with Pipeline.parse(f"filesrc location={turned_video} ! packetsink location={copy}") as pipeline:
        pipeline.bus.watch(messages.append)
        pipeline.run(timeout_s=60)
    (warning,) = (message.text for message in messages if message.kind is MessageKind.WARNING)
    assert "the copy does not say that its frames are to be turned" in warning


def test_telemetry_is_recorded_with_its_times(streamkit_data: Path, tmp_path: Path) -> None:
    """277 frames and 277 KLV packets of a real stream are the same in the copy, and pair as before."""
    location, copy = streamkit_data / "telemetry" / "sample-stream.ts", tmp_path / "copy.ts"
    text = f"filesrc name=s location={location}  s.video ! packetsink name=p location={copy}  s.klv ! p.klv"
    Pipeline.parse(text).run(timeout_s=20)
    streams = []
    for path in (location, copy):
        with av.open(str(path)) as container:
            klv = next(stream for stream in container.streams if stream.name == "klv")
            streams.append([bytes(p) for p in container.demux(klv) if p.size])
    assert streams[0] == streams[1]
    assert len(KlvReader().feed(b"".join(streams[1]))) == 277
    text = (
        f"filesrc name=s location={copy}  s.video ! decode ! posesync name=p ! fakesink  s.klv ! p.telemetry"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        message = pipeline.bus.pop(20, (MessageKind.ELEMENT,))
        while message is not None and message.fields["name"] != "telemetry":
            message = pipeline.bus.pop(20, (MessageKind.ELEMENT,))
    assert message is not None
    assert (message.fields["paired"], message.fields["largest_gap_ns"]) == (277, 0)


RECORD = """
import sys
from streamkit import Pipeline
text = sys.argv[1]
pipeline = Pipeline.parse(text)
pipeline.play()
for frame in pipeline["seen"]:
    print(frame.pts, flush=True)
"""


@pytest.mark.parametrize("name", ["live.ts", "live.mp4"])
def test_killing_the_process_loses_two_seconds_at_most(tmp_path: Path, name: str) -> None:
    """A recording plays up to two seconds before the moment its process was killed with -9."""
    path = tmp_path / name
    text = (
        "videotestsrc is-live=true num-buffers=300 ! video/x-raw,width=64,height=48,framerate=30/1 "
        f"! encode gop=150 live=true ! tee name=t  t. ! packetsink location={path}  t. ! appsink name=seen"
    )
    process = subprocess.Popen([sys.executable, "-c", RECORD, text], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    seen = 0
    for line in process.stdout:
        seen = int(line)
        if seen > 2.6e9:
            process.send_signal(signal.SIGKILL)
            break
    process.stdout.close()
    process.wait(10)
    times = packets(path)
    assert times[-1][0] > seen - 2e9
    assert len(video_frames(path)) >= (seen - 2e9) * 30 / 1e9


def test_segments_by_time(make_video: MakeVideo, tmp_path: Path) -> None:
    """Each segment begins with a keyframe, is as long as asked, and together they hold every frame."""
    source = make_video("long_for_segments.mp4", count=60)
    text = f"filesrc location={source} ! packetsink location={tmp_path}/part-%03d.ts max-size-time=700000000"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert pipeline.wait(20) is not None
    parts = sorted(tmp_path.glob("part-*.ts"))
    assert parts[0].name == "part-000.ts"
    assert [video_frame for path in parts for video_frame in video_frames(path)] == video_frames(source)
    lengths = [len(video_frames(path)) / 25 for path in parts]
    assert len(lengths) == 3
    assert all(0.7 <= length <= 0.7 + 0.24 for length in lengths[:-1])


def test_a_segment_that_cannot_end_is_told(make_video: MakeVideo, tmp_path: Path) -> None:
    """Once, where the keyframes are too far apart for the length asked."""
    source = make_video("one_key_frame.mp4", count=60, options={"g": "250"})
    text = f"filesrc location={source} ! packetsink location={tmp_path}/part-%03d.ts max-size-time=500000000"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        kinds = (MessageKind.WARNING, MessageKind.EOS, MessageKind.ERROR)
        told, ended = (pipeline.bus.pop(20, kinds) for _ in range(2))
    assert told is not None
    assert ended is not None
    assert "max-size-time is 0.5 s: no keyframe has come" in told.text
    assert ended.kind is MessageKind.EOS


@pytest.mark.parametrize("name", ["x.m3u8", "x-%02d.ts"])
def test_segments_that_end_are_not_warned_of(tmp_path: Path, name: str) -> None:
    """Though a playlist, whose segments FFmpeg ends, is longer than two of them."""
    limit = "max-size-time=300000000"
    assert recorded(tmp_path / name, reordered(0), limit) == ({}, [])
    assert len(list(tmp_path.glob("*.ts"))) > 3


def test_segments_by_size_get_a_number(make_video: MakeVideo, tmp_path: Path) -> None:
    """A name without a number gets one when there is a limit."""
    source = make_video("long_for_segments.mp4", count=60)
    text = f"filesrc location={source} ! packetsink location={tmp_path}/part.mkv max-size-bytes=1500"
    Pipeline.parse(text).run(timeout_s=20)
    parts = sorted(tmp_path.glob("part-*.mkv"))
    assert parts[0].name == "part-00000.mkv"
    assert len(parts) > 2
    assert sum(len(video_frames(path)) for path in parts) == 60


def test_what_comes_before_a_key_frame_is_counted(small_video: Path, tmp_path: Path) -> None:
    """A recording begins with a keyframe; what cannot be decoded is left out and counted."""
    with Pipeline.parse(f"filesrc location={small_video} ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    with Harness("packetsink", location=str(tmp_path / "late.ts")) as harness:
        for frame in frames[3:]:
            harness.push(frame)
        harness.drain()
        assert harness.element.drops == {"before the first keyframe": 3}
    assert len(video_frames(tmp_path / "late.ts")) == 6


def test_a_new_format_needs_a_new_file(make_video: MakeVideo, tmp_path: Path) -> None:
    """With a number in the name the next segment begins; without one the error says so."""
    frames = []
    for name, size in (("one.mkv", (64, 48)), ("two.mkv", (96, 64))):
        with Pipeline.parse(f"filesrc location={make_video(name, size=size)} ! appsink name=out") as pipeline:
            pipeline.play()
            frames.append(next(iter(pipeline["out"])))
    with Harness("packetsink", location=str(tmp_path / "x-%d.ts")) as harness:
        for frame in frames:
            harness.push(frame)
        harness.drain()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x-0.ts", "x-1.ts"]
    with Harness("packetsink", location=str(tmp_path / "y.ts")) as harness:
        harness.push(frames[0])
        with pytest.raises(ElementFailure, match=r"one file holds one format.*flight-%05d"):
            harness.push(frames[1])


@pytest.mark.parametrize(
    ("properties", "rule"),
    [
        ("", "location must be set"),
        ("location=x.avi", r"must end in \.mp4, \.mov, \.mkv, \.ts"),
        ("location=/etc/passwd/x.ts", "cannot be written: Not a directory"),
    ],
)
def test_bad_names_fail_before_playing(properties: str, rule: str) -> None:
    """What can be known is known when the pipeline is built, or when the element starts."""
    with pytest.raises((DescriptionError, ElementFailure), match=rule):
        Pipeline.parse(f"fakesrc num-buffers=1 ! packetsink {properties}").run(timeout_s=5)


def test_telemetry_needs_a_transport_stream(streamkit_data: Path, tmp_path: Path) -> None:
    """Other containers cannot hold KLV: an error before anything is recorded."""
    location = streamkit_data / "telemetry" / "sample-stream.ts"
    sink = f"packetsink name=p location={tmp_path}/x.mp4"
    text = f"filesrc name=s location={location}  s.video ! {sink}  s.klv ! p.klv"
    with pytest.raises(DescriptionError, match=r"only \.ts holds KLV"):
        Pipeline.parse(text).run(timeout_s=5)


def test_damaged_packets_are_left_out(tmp_path: Path) -> None:
    """A length that leads out of the packet costs this packet and a warning."""
    caps = Caps("video/x-h264, width=16, height=16, codec_data=(string)0142c00affe100020000010000")
    with Harness("packetsink", location=str(tmp_path / "x.ts")) as harness:
        harness.push(Frame(b"\xff\xff\xff\xff\x65", caps, pts=0, flags=FrameFlags.KEYFRAME))
        assert harness.element.drops == {"damaged packet": 1}
        assert "a NAL unit" in harness.messages[-1].text


def test_a_recording_plays_again_as_it_came(small_video: Path, tmp_path: Path) -> None:
    """Replaysrc gives numbers, epochs, times, capture and marks of the live frames, at their intervals."""
    path = tmp_path / "flight.ts"
    with Pipeline.parse(f"filesrc location={small_video} ! appsink name=out") as pipeline:
        pipeline.play()
        frames = [
            frame.replace(seq=7 + 2 * n, epoch=n // 6, arrival_ns=10**9 + n * 20_000_000)
            for n, frame in enumerate(pipeline["out"])
        ]
    with Harness("packetsink", location=str(path), arrivals=True) as harness:
        for frame in frames:
            harness.push(frame)
        harness.drain()
    with Pipeline.parse(f"replaysrc location={path} ! appsink name=out") as pipeline:
        pipeline.play()
        again = list(pipeline["out"])
    assert [(f.seq, f.epoch, f.pts, f.flags) for f in again] == [
        (f.seq, f.epoch, f.pts, f.flags) for f in frames
    ]
    assert {b.arrival_ns - a.arrival_ns for a, b in pairwise(again)} == {20_000_000}
    assert [bytes(f.data) for f in again] == [data for _, data in packets(path)]


def test_a_replay_may_be_ended_in_a_pause(small_video: Path, tmp_path: Path) -> None:
    """`finish` ends a recording that is replayed at once, though its next packet came an hour later."""
    path = tmp_path / "flight.ts"
    with Pipeline.parse(f"filesrc location={small_video} ! appsink name=out") as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    with Harness("packetsink", location=str(path), arrivals=True) as harness:
        for n, frame in enumerate(frames):
            harness.push(frame.replace(arrival_ns=10**9 + n * 3600 * 10**9))
        harness.drain()
    with Pipeline.parse(f"replaysrc location={path} ! appsink name=out") as pipeline:
        pipeline.play()
        again = iter(pipeline["out"])
        next(again)
        pipeline.finish()
        assert list(again) == []
        ended = pipeline.wait(10)
    assert ended is not None
    assert ended.kind is MessageKind.EOS


def test_replay_needs_arrivals(small_video: Path) -> None:
    """A file without arrivals is refused with a remedy."""
    with pytest.raises(ElementFailure, match="it has no file of arrivals; record with packetsink arrivals"):
        Pipeline.parse(f"replaysrc location={small_video} ! fakesink").run(timeout_s=5)


@pytest.mark.parametrize(("location", "rule"), [("/", "a file is needed"), ("nosuch.ts", "must be there")])
def test_replay_needs_a_file(location: str, rule: str) -> None:
    """A location that is not a file is refused."""
    with pytest.raises(ElementFailure, match=rule) as failure:
        Pipeline.parse(f"replaysrc location={location} ! fakesink").run(timeout_s=5)
    assert isinstance(failure.value.cause, ResourceError)


def test_times_do_not_drift(tmp_path: Path) -> None:
    """After ten hours the time of a frame is that of its number over the rate, to the tick of the file."""
    caps = Caps("video/x-raw, format=GRAY8, width=16, height=16, framerate=30000/1001")
    rate, count = Fraction(30000, 1001), 10 * 3600 * 30
    with (
        Harness("encode", live=True) as encoder,
        Harness("packetsink", location=str(tmp_path / "x.ts")) as sink,
    ):
        import numpy as np

        for number in (0, count):
            frame = Frame(np.zeros((16, 16), np.uint8), caps, pts=round(number * 10**9 / rate))
            for packet in encoder.push(frame):
                sink.push(packet)
        sink.drain()
    assert abs(packets(tmp_path / "x.ts")[1][0] - round(count * 10**9 / rate)) < 20_000


# Inside it a count of reference frame sets is damaged: the muxer of Matroska reads this set for minutes.
ENDLESS_SET = bytes.fromhex(
    "42010101600000030090000003000003003ca00a080f16592a4980808080808032b9a02000000300200000030321"
)
REMUX = """
import sys
from pathlib import Path
from streamkit import Caps, Frame, FrameFlags, Pipeline
with Pipeline.parse(f"appsrc name=in ! packetsink name=out location={sys.argv[1]}") as pipeline:
    pipeline.play()
    for number, path in enumerate(sys.argv[2:]):
        data, caps = Path(path).read_bytes(), Caps("video/x-h265, width=64, height=48")
        pipeline["in"].push(Frame(data, caps, pts=number * 10**9, flags=FrameFlags.KEYFRAME))
    pipeline["in"].end()
    pipeline.wait(100)
    print(dict(pipeline["out"].drops))
"""


def recorded(path: Path, frames: list[Frame], properties: str = "") -> tuple[dict[str, int], list[str]]:
    """Records packets; the sink's drops and warnings.

    Raises:
        ElementFailure: the pipeline failed.
    """
    with Pipeline.parse(f"appsrc name=in ! packetsink name=out location={path} {properties}") as pipeline:
        pipeline.play()
        for frame in frames:
            pipeline["in"].push(frame)
        pipeline["in"].end()
        warnings = []
        while message := pipeline.bus.pop(20, (MessageKind.WARNING, MessageKind.EOS, MessageKind.ERROR)):
            if message.error is not None:
                raise message.error
            if message.kind is MessageKind.EOS:
                break
            warnings.append(message.text)
        return dict(pipeline["out"].drops), warnings


def first_units(path: Path) -> list[bytes]:
    """The NAL units of a file's first packet, which has start codes."""
    return list(units(packets(path)[0][1]))


@pytest.mark.parametrize("ending", [".mkv", ".mp4"])
def test_a_damaged_header_does_not_freeze_the_process(
    make_video: MakeVideo, tmp_path: Path, ending: str
) -> None:
    """Parameter sets that keep FFmpeg's muxer busy are left out, and the next keyframe begins the file."""
    whole = first_units(make_video("header.ts", codec="libx265"))
    damaged = [ENDLESS_SET if unit[0] >> 1 == 33 else unit for unit in whole]
    assert damaged != whole
    for name, found in (("damaged", damaged), ("whole", whole)):
        (tmp_path / name).write_bytes(b"".join(b"\0\0\0\1" + unit for unit in found))
    arguments = [str(tmp_path / name) for name in (f"out{ending}", "damaged", "whole")]
    done = subprocess.run(
        [sys.executable, "-c", REMUX, *arguments], capture_output=True, text=True, timeout=30, check=False
    )
    assert done.stdout == "{'damaged packet': 1}\n", done.stderr
    assert len(video_frames(tmp_path / f"out{ending}")) == 1


def damage_sets(frame: Frame) -> Frame:
    """The packet with its sequence parameter sets cut short."""
    kept = [
        unit[:3] if unit[0] & 31 == 7 or unit[0] >> 1 == 33 else unit for unit in units(bytes(frame.data))
    ]
    return frame.replace(data=b"".join(b"\0\0\0\1" + unit for unit in kept))


@pytest.mark.parametrize("codec", ["libx264", "libx265"])
@pytest.mark.parametrize("ending", [".mkv", ".mp4"])
def test_a_recording_begins_behind_a_damaged_key_frame(
    make_video: MakeVideo, tmp_path: Path, codec: str, ending: str
) -> None:
    """A file that cannot begin with its first keyframe begins with the next; no descriptor stays open."""
    options = {"g": "6"} if codec == "libx264" else {"x265-params": "log-level=error:keyint=6:bframes=0"}
    source = make_video(f"behind_{codec}.ts", codec=codec, bframes=0, options=options, count=18)
    with Pipeline.parse(f"filesrc location={source} ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    caps = frames[0].caps.without_fields("codec_data")
    frames = [frame.replace(caps=caps) for frame in frames]
    path = tmp_path / f"late-%d{ending}"
    before = len(list(Path("/proc/self/fd").iterdir()))
    damaged = [damage_sets(frames[0]), *frames[1:]]
    drops, warnings = recorded(path, damaged, "arrivals=true")
    assert drops == {"damaged packet": 1, "before the first keyframe": 5}
    assert len(warnings) == 1
    assert "a packet is left out" in warnings[0]
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    assert sorted(found.name for found in tmp_path.iterdir()) == [
        f"late-0{ending}", f"late-0{ending}.arrivals.jsonl",
    ]  # fmt: skip
    assert len(video_frames(tmp_path / f"late-0{ending}")) == 12


def test_a_recording_of_nothing_but_damage_is_an_error(make_video: MakeVideo, tmp_path: Path) -> None:
    """Where no keyframe is whole EOS turns into an error with the count, and no file is left."""
    source = make_video("all_damaged.ts", bframes=0)
    with Pipeline.parse(f"filesrc location={source} ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    caps = frames[0].caps.without_fields("codec_data")
    with pytest.raises(ElementFailure, match=r"nothing is written: 2 packets are damaged"):
        recorded(tmp_path / "x.mkv", [damage_sets(frame).replace(caps=caps) for frame in frames])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", [".mkv", ".mp4", ".ts"])
def test_a_damaged_packet_is_left_out_and_recording_continues(
    small_video: Path, tmp_path: Path, ending: str
) -> None:
    """A packet whose time no container holds is counted; those behind it are written at their times."""
    with Pipeline.parse(f"filesrc location={small_video} ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    frames[7] = frames[7].replace(pts=2**80)
    path = tmp_path / f"on{ending}"
    assert recorded(path, frames)[0] == {"damaged packet": 1}
    times = [time for time, _ in packets(path)]
    assert len(times) == 11
    assert max(times) < 10**9


@pytest.mark.parametrize("ending", ["ts", "m2ts", "mp4", "mov", "mkv", "m3u8"])
@pytest.mark.parametrize("codec", list(Codec))
def test_what_is_encoded_can_be_read_or_is_refused(tmp_path: Path, codec: Codec, ending: str) -> None:
    """The refusal names containers that hold the codec, and no file is left."""
    everywhere = codec in (Codec.H264, Codec.H265, Codec.MPEG4)
    held = everywhere or ending == "mkv" or (ending in ("mp4", "mov") and codec is Codec.MJPEG)
    held |= ending == "mp4" and codec in (Codec.AV1, Codec.VP9, Codec.FFV1)
    path = tmp_path / f"x.{ending}"
    source = "videotestsrc num-buffers=12 ! video/x-raw, format=I420, width=96, height=64"
    text = f"{source} ! encode codec={codec} ! packetsink location={path}"
    if held:
        Pipeline.parse(text).run(timeout_s=20)
        assert len(video_frames(path)) == 12
        return
    with pytest.raises(ElementFailure, match=r"holds no \S+; write .*\.mkv, or encode to h264"):
        Pipeline.parse(text).run(timeout_s=20)
    assert list(tmp_path.iterdir()) == []


def test_headers_beside_the_packets_are_recorded_or_refused(tmp_path: Path) -> None:
    """MPEG-4 has them in an MP4 file; FFV1 of version 3 always, which PyAV gives no muxer."""
    for codec, first, second in (("mpeg4", "a.mp4", "a.ts"), ("ffv1", "b.mkv", "c.mkv")):
        with av.open(str(tmp_path / first), "w") as container:
            stream = container.add_stream(codec, rate=25)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
            for number in range(25):
                planes = np.random.default_rng(number).integers(0, 256, (72, 64), dtype=np.uint8)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(planes, "yuv420p")))
            container.mux(stream.encode(None))
        copy = Pipeline.parse(
            f"filesrc location={tmp_path / first} ! packetsink location={tmp_path / second}"
        )
        if codec == "ffv1":
            with pytest.raises(
                ElementFailure, match="ffv1 has headers outside its packets; put decode ! enc"
            ):
                copy.run(timeout_s=20)
            assert not (tmp_path / second).exists()
        else:
            copy.run(timeout_s=20)
            assert video_frames(tmp_path / second) == video_frames(tmp_path / first)


def test_a_codec_that_the_container_does_not_take_is_an_error(tmp_path: Path) -> None:
    """The error comes at once, not as damage, and no empty file remains."""
    caps = Caps("image/bmp, width=16, height=16")
    with pytest.raises(ElementFailure, match="cannot be written: mp4 holds no bmp; encode"):
        recorded(tmp_path / "x.mp4", [Frame(b"BM", caps, pts=0, flags=FrameFlags.KEYFRAME)])
    assert list(tmp_path.iterdir()) == []


def test_a_recording_is_never_overwritten(make_video: MakeVideo, tmp_path: Path) -> None:
    """Started again, segments and their arrivals go on at the next number; one file is refused."""
    source = make_video("long_for_segments.mp4", count=60)
    sink = "packetsink arrivals=true max-size-time=700000000"
    for _ in range(2):
        Pipeline.parse(f"filesrc location={source} ! {sink} location={tmp_path}/flight-%05d.ts").run(20)
    segments = sorted(tmp_path.glob("flight-*.ts"))
    assert [path.name for path in segments] == [f"flight-{number:05d}.ts" for number in range(6)]
    assert video_frames(segments[0]) == video_frames(segments[3])
    assert len(list(tmp_path.glob("flight-*.arrivals.jsonl"))) == 6
    text = f"filesrc location={source} ! packetsink location={tmp_path}/one.ts"
    Pipeline.parse(text).run(20)
    with pytest.raises(ElementFailure, match=r"one\.ts exists already, .*; name another file, number them"):
        Pipeline.parse(text).run(20)
    Pipeline.parse(f"{text} if-exists=replace").run(20)
    assert len(video_frames(tmp_path / "one.ts")) == 60


def test_a_second_recorder_of_the_same_segments_is_refused(small_video: Path, tmp_path: Path) -> None:
    """When it starts: it would take the next number of the first, which would end with an error."""
    with Pipeline.parse(f"filesrc location={small_video} ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    text = f"filesrc location={small_video} ! packetsink location={tmp_path}/%d.ts max-size-time=1"
    (tmp_path / "6.ts").touch()
    with Harness("packetsink", location=f"{tmp_path}/%d.ts", max_size_time=1) as first:
        first.push(frames[0])
        assert (tmp_path / "7.ts").exists()
        with pytest.raises(ElementFailure, match=r"packetsink0: .*: another process or pipeline is writing"):
            Pipeline.parse(text).run(timeout_s=20)
        for frame in frames[1:]:
            first.push(frame)
        first.drain()
    Pipeline.parse(text).run(timeout_s=20)
    assert {path.name for path in tmp_path.glob("*.ts")} == {"6.ts", "7.ts", "8.ts", "9.ts", "10.ts"}


def test_the_oldest_segments_are_deleted(make_video: MakeVideo, tmp_path: Path) -> None:
    """With their arrivals, also those of an earlier run, and nothing else."""
    source = make_video("long_for_segments.mp4", count=60)
    (tmp_path / "flight-copy.ts").write_bytes(b"mine")
    sink = f"packetsink location={tmp_path}/flight-%05d.ts arrivals=true max-size-time=700000000 max-files=2"
    for _ in range(2):
        Pipeline.parse(f"filesrc location={source} ! {sink}").run(20)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        ".flight-%05d.ts.written", "flight-00004.ts", "flight-00004.ts.arrivals.jsonl",
        "flight-00005.ts", "flight-00005.ts.arrivals.jsonl", "flight-copy.ts",
    ]  # fmt: skip


def test_a_full_disk_ends_the_recording_and_not_the_pipeline(small_video: Path, tmp_path: Path) -> None:
    """Behind a tee; a warning names the file and the remedy."""
    (tmp_path / "full.ts").symlink_to("/dev/full")
    text = (
        f"filesrc location={small_video} ! tee name=t  t. ! queue ! packetsink location={tmp_path}/full.ts "
        "t. ! queue ! fakesink name=other"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        warning = pipeline.bus.pop(10, (MessageKind.WARNING,))
        ended = pipeline.wait(10)
    assert warning is not None
    assert "full.ts: cannot be written: No space left on device; free some space" in warning.text
    assert ended is not None
    assert ended.kind is MessageKind.EOS
    assert pipeline["other"].count == 12


@pytest.mark.parametrize(
    ("name", "position", "value"),
    [
        ("avi/blackwhite_yuv420p.avi", 130, 0xC1),
        ("avi/mjpeg.avi", 131, 0x92),
        ("mp4/white.mp4", 11781, 0xC2),
    ],
)
def test_a_frame_of_hours_ends_in_an_error_and_not_in_a_crash(
    streamkit_data: Path, tmp_path: Path, name: str, position: int, value: int
) -> None:
    """Durations beyond 32 bits, which crash FFmpeg's hybrid fragments, leave the process alive."""
    data = bytearray((streamkit_data / "odd_media" / "corpus" / name).read_bytes())
    data[position] = value
    source = tmp_path / Path(name).name
    source.write_bytes(data)
    text = f"filesrc location={source} ! packetsink location={tmp_path / 'copy.mp4'}"
    script = f"from streamkit import Pipeline; Pipeline.parse({text!r}).run(timeout_s=20)"
    result = subprocess.run(
        [sys.executable, "-c", script], check=False, capture_output=True, text=True, timeout=40
    )
    assert result.returncode in (0, 1)
    assert result.returncode == 0 or "packetsink0: location=" in result.stderr


def test_a_pause_too_long_for_mp4_is_refused(tmp_path: Path) -> None:
    """A pause of seven hours ends an MP4 with an error; the same pause is in an MKV."""
    for name in ("pause.mkv", "pause.mp4"):
        caps = "video/x-raw,format=GRAY8,width=64,height=48,framerate=25/1"
        text = f"appsrc name=a caps={caps} ! encode gop=5 live=true ! packetsink location={tmp_path / name}"
        with Pipeline.parse(text) as pipeline:
            pipeline.play()
            for index in range(20):
                pause = 7 * 3600 * 10**9 if index >= 10 else 0
                pipeline["a"].push(np.zeros((48, 64), np.uint8), pts=index * 40_000_000 + pause)
            pipeline["a"].end()
            pipeline.wait(20)
            error = pipeline.error
        assert (error is None) == (name == "pause.mkv")
        assert error is None or "6.6 h between two frames" in str(error)
    assert packets(tmp_path / "pause.mkv")[-1][0] > 7 * 3600 * 10**9
