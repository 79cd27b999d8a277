import math
import subprocess
import sys
from pathlib import Path

import pytest

from streamkit import (
    Caps,
    ElementFailure,
    Frame,
    Message,
    MessageKind,
    Pipeline,
    Pose,
    PropertyError,
    raw_video_caps,
)
from streamkit.testing import Harness
from streamkit_telemetry.samplebuffer import CAPACITY
from streamkit_telemetry_formats.klv import UAS_LOCAL_SET, checksum
from streamkit_telemetry_formats.sample import Sample

VIDEO = raw_video_caps("GRAY8", 4, 2)
KLV = Caps("meta/x-klv, parsed=(boolean)false")
MS = 1_000_000


def klv_packet(latitude: float, time_us: int = 0) -> bytes:
    """A packet with time, latitude, longitude 0 and checksum."""
    number = round(latitude / 90 * (2**31 - 1))
    value = b"\x02\x08" + time_us.to_bytes(8, "big") + b"\x0d\x04" + number.to_bytes(4, "big", signed=True)
    value += b"\x0e\x04" + bytes(4) + b"\x01\x02"
    data = UAS_LOCAL_SET + bytes([len(value) + 2]) + value
    return data + checksum(data).to_bytes(2, "big")


def video_frame(pts: int, epoch: int = 0) -> Frame:
    """A frame of a time."""
    return Frame(bytes(8), VIDEO, pts=pts, epoch=epoch)


def telemetry(pts: int, latitude: float, epoch: int = 0) -> Frame:
    """A KLV frame of a time."""
    return Frame(klv_packet(latitude), KLV, pts=pts, epoch=epoch)


def latitudes(frames: list[Frame]) -> list[float | None]:
    """Of the poses of frames, rounded."""
    return [round(pose.latitude, 3) if (pose := frame.get(Pose)) else None for frame in frames]


def next_telemetry(pipeline: Pipeline) -> Message | None:
    """The next message about telemetry."""
    while (message := pipeline.bus.pop(5, (MessageKind.ELEMENT,))) is not None:
        if message.fields["name"] == "telemetry":
            return message
    return None


def test_a_real_stream_pairs_each_frame(streamkit_data: Path) -> None:
    """277 frames of a real recording get 277 poses, each with its own time and gap 0."""
    location = streamkit_data / "telemetry" / "sample-stream.ts"
    video = "s.video ! decode ! posesync name=p ! appsink name=out max-buffers=0"
    text = f"filesrc name=s location={location}  {video}  s.klv ! p.telemetry"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
        message = next_telemetry(pipeline)
    poses = [frame.get(Pose) for frame in frames]
    assert len(poses) == 277
    assert all(pose is not None and pose.gap_ns == 0 and not pose.is_stale for pose in poses)
    assert [frame.pts for frame in frames] == [frame.get(Sample).pts for frame in frames]
    assert {frame.capture.origin for frame in frames} == {"misb"}
    assert message is not None
    assert {key: message.fields[key] for key in ("poses", "paired", "bad_packets", "largest_gap_ns")} == {
        "poses": 277,
        "paired": 277,
        "bad_packets": 0,
        "largest_gap_ns": 0,
    }


def test_frames_wait_for_the_telemetry_after_them() -> None:
    """A frame is sent when a sample of its time or later has arrived, with an interpolated pose."""
    with Harness("posesync") as harness:
        assert harness.push(telemetry(0, 10.0), "telemetry") == []
        assert latitudes(harness.push(video_frame(0))) == [10.0]
        assert harness.push(video_frame(50 * MS)) == []
        assert latitudes(harness.push(telemetry(100 * MS, 12.0), "telemetry")) == [11.0]


def test_the_last_frames_come_at_the_end() -> None:
    """Frames after the last sample are given out at EOS with the gap to it; far ones are marked stale."""
    with Harness("posesync", max_gap_s=0.1) as harness:
        harness.push(telemetry(0, 10.0), "telemetry")
        harness.push(video_frame(80 * MS))
        harness.push(video_frame(120 * MS))
        frames = harness.drain()
        message = next(m for m in harness.messages if m.kind is MessageKind.ELEMENT)
    poses = [frame.get(Pose) for frame in frames]
    assert [(pose.gap_ns, pose.is_stale) for pose in poses if pose] == [(-80 * MS, False), (-120 * MS, True)]
    assert (message.fields["paired"], message.fields["stale"]) == (1, 1)


def test_frames_without_any_telemetry_pass_bare() -> None:
    """Without telemetry frames have no pose, few are held, and a warning comes at the end."""
    with Harness("posesync") as harness:
        frames = [out for n in range(100) for out in harness.push(video_frame(n * MS))]
        assert len(frames) >= 100 - 33
        frames += harness.drain()
        (warning,) = (m.text for m in harness.messages if m.kind is MessageKind.WARNING)
        assert warning.startswith(
            "no frame has got a pose: no telemetry came; link the source's klv or subtitle to"
        )
    assert latitudes(frames) == [None] * 100


def test_damage_is_counted_and_reported() -> None:
    """A packet with a flipped byte is refused with a warning."""
    broken = bytearray(klv_packet(10.0))
    broken[25] ^= 1
    with Harness("posesync") as harness:
        harness.push(Frame(bytes(broken), KLV, pts=0), "telemetry")
        harness.push(telemetry(10, 20.0), "telemetry")
        assert latitudes(harness.push(video_frame(5))) == [20.0]
        assert [m.text for m in harness.messages if m.kind is MessageKind.WARNING] == [
            "1 telemetry packets refused so far: checksum or form is wrong"
        ]


def test_a_new_epoch_forgets_the_old_telemetry() -> None:
    """Samples of the connection before do not serve frames of the one after."""
    with Harness("posesync") as harness:
        harness.push(telemetry(0, 10.0), "telemetry")
        assert latitudes(harness.push(video_frame(0))) == [10.0]
        frames = harness.push(video_frame(1 * MS, epoch=1)) + harness.drain()
    assert latitudes(frames) == [None]


def test_a_file_counts_from_the_first_frame_of_the_video(streamkit_data: Path, tmp_path: Path) -> None:
    """The stream begins at 2.167 s: its KLV in a file of its own gives each frame the same pose.

    Also where the file is read in another process than the poses are joined.
    """
    stream, raw = streamkit_data / "telemetry" / "sample-stream.ts", tmp_path / "raw.klv"
    Pipeline.parse(f"filesrc name=s location={stream}  s.klv ! filesink location={raw}").run(timeout_s=30)

    def flown(start_s: int, telemetry: str, is_apart: bool = False) -> dict[int, float]:
        video = f"filesrc name=s location={stream} start-s={start_s} ! decode"
        apart = "( process=true identity ) !" if is_apart else ""
        text = f"( process={is_apart} {video} ) ! {apart} posesync name=p {telemetry}"
        with Pipeline.parse(f"{text}  p. ! appsink name=out max-buffers=0") as pipeline:
            pipeline.play()
            return {frame.pts or 0: pose.latitude for frame in pipeline["out"] if (pose := frame.get(Pose))}

    inside = flown(0, " s.klv ! p.telemetry")
    assert min(inside) == 2_167_000_000
    for start_s, is_apart in ((0, False), (5, False), (5, True)):
        beside = flown(start_s, f"location={raw}", is_apart)
        assert len(beside) == 277 - 30 * start_s
        assert beside == pytest.approx({pts: inside[pts] for pts in beside}, abs=1e-8)  # 1 mm


def test_a_dji_file_beside_the_video(streamkit_data: Path) -> None:
    """location= names the subtitles; positions between two are interpolated; offset-s= moves them."""
    location = streamkit_data / "telemetry" / "dji" / "p4_rtk.SRT"
    with Harness("posesync", location=str(location)) as harness:
        (frame,) = harness.push(video_frame(500 * MS))
        pose = frame.get(Pose)
        assert pose is not None
        assert pose.latitude == pytest.approx((-34.237922 - 34.237911) / 2)
        assert abs(pose.gap_ns) == 500 * MS
        assert math.degrees(pose.heading or 0) == pytest.approx(110.2)
        assert frame.capture is None
    with Harness("posesync", location=str(location), offset_s=-1.0) as harness:
        (frame,) = harness.push(video_frame(0))
        assert frame.get(Pose).latitude == -34.237911  # type: ignore[union-attr]


def test_subtitles_inside_the_video() -> None:
    """Subtitle packets, also as FFmpeg wraps them in ASS lines, are read like the file."""
    text = "0,0,Default,,0,0,0,,[latitude: 41.5] [longitude: 2.5] [altitude: 117.0]"
    with Harness("posesync") as harness:
        harness.push(Frame(text.encode(), Caps("text/x-raw, format=utf8"), pts=0), "telemetry")
        assert latitudes(harness.push(video_frame(0))) == [41.5]


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        ("dji/nosuch.SRT", "cannot be read: No such file"),
        ("dji/broken_empty.SRT", "no position in it"),
        (
            "sample-stream.ts",
            r"no position in it.*; link what a video itself holds, as s\.klv ! p\.telemetry",
        ),
    ],
)
def test_bad_files_fail_before_playing(streamkit_data: Path, name: str, rule: str) -> None:
    """A file that is not there or holds no position is refused when the element starts."""
    location = streamkit_data / "telemetry" / name
    with pytest.raises(ElementFailure, match=rule):
        Pipeline.parse(f"fakesrc num-buffers=1 ! posesync name=p location={location} ! fakesink").run(
            timeout_s=5
        )


def subtitles(path: Path, count: int, period_ms: int = 33) -> Path:
    """A file with a position every few milliseconds; the latitude identifies each."""

    def stamp(ms: int) -> str:
        return f"{ms // 3600000:02}:{ms // 60000 % 60:02}:{ms // 1000 % 60:02},{ms % 1000:03}"

    with path.open("w", encoding="ascii") as file:
        for n in range(count):
            file.write(f"{n + 1}\n{stamp(n * period_ms)} --> {stamp((n + 1) * period_ms)}\n")
            file.write(f"[latitude: {n / 1000:.3f}] [longitude: 2.5] [altitude: 117.0]\n\n")
    return path


def test_the_whole_file_counts_in_bounded_memory(tmp_path: Path) -> None:
    """Each of 10000 frames has its own pose, and no more samples are held than the line holds."""
    count = 10_000
    with Harness("posesync", location=str(subtitles(tmp_path / "long.SRT", count))) as harness:
        for n in range(count):
            (frame,) = harness.push(video_frame(n * 33 * MS))
            assert latitudes([frame]) == [n / 1000]
        assert len(harness.element._samples) <= CAPACITY
        harness.drain()
        message = next(m for m in harness.messages if m.kind is MessageKind.ELEMENT)
    assert (message.fields["poses"], message.fields["paired"], message.fields["stale"]) == (count, count, 0)


def test_a_file_is_read_again_for_earlier_frames(tmp_path: Path) -> None:
    """Frames before what is still held, and frames of a new epoch, find their poses in the file."""
    count = 2 * CAPACITY
    with Harness("posesync", location=str(subtitles(tmp_path / "long.SRT", count))) as harness:
        for n in (count - 1, 3):
            assert latitudes(harness.push(video_frame(n * 33 * MS))) == [n / 1000]
        assert latitudes(harness.push(video_frame(7 * 33 * MS, epoch=1))) == [0.007]


def test_broken_subtitles_are_warned_about(tmp_path: Path) -> None:
    """A warning reports them, and the counts hold their number."""
    path = subtitles(tmp_path / "flight.SRT", 20)
    path.write_text(path.read_text().replace("[latitude: 0.00", "[latitude: oo"))
    with Harness("posesync", location=str(path)) as harness:
        harness.push(video_frame(0))
        harness.drain()
        warnings = [m.text for m in harness.messages if m.kind is MessageKind.WARNING]
        message = next(m for m in harness.messages if m.kind is MessageKind.ELEMENT)
    assert warnings == ["10 subtitles left out so far: their times or position cannot be read"]
    assert message.fields["broken_subtitles"] == 10


@pytest.mark.parametrize("text", ["max_gap_s=1e300", "max_gap_s=inf", "offset_s=1e300", "offset_s=-inf"])
def test_times_beyond_reason_are_refused(text: str) -> None:
    """Seconds that no clock reaches are an error of the property, not of the arithmetic."""
    name, _, value = text.partition("=")
    with pytest.raises(PropertyError, match=r"property (max-gap|offset)-s cannot be"):
        Harness("posesync", **{name: float(value)})


def test_hostile_packets_leave_the_frames_alone() -> None:
    """A packet with a good checksum and values of wrong lengths is paired without them, with a warning."""
    number = b"\x08\x81\x80" + b"\xff" * 128
    bare = klv_packet(10.0)[17:-4]
    value = bare + number + b"\x01\x02"
    data = UAS_LOCAL_SET + b"\x82" + (len(value) + 2).to_bytes(2, "big") + value
    data += checksum(data).to_bytes(2, "big")
    with Harness("posesync") as harness:
        harness.push(Frame(data, KLV, pts=0), "telemetry")
        assert latitudes(harness.push(video_frame(0))) == [10.0]
        assert [m.text for m in harness.messages if m.kind is MessageKind.WARNING] == [
            "1 telemetry values left out so far: not of the length or range of their tag"
        ]


def test_a_video_without_telemetry_has_one_warning(tmp_path: Path) -> None:
    """That of the source; with --strict the code is 1."""
    run = [str(Path(sys.executable).with_name("streamkit")), "launch"]
    video = tmp_path / "flight.mp4"
    subprocess.run([*run, f"videotestsrc num-buffers=5 ! videofilesink location={video}"], check=True)
    text = (
        f"filesrc name=file location={video} file.video ! decode ! posesync name=pose ! fakesink "
        "file.klv ! tee name=klv klv. ! pose.telemetry klv. ! queue ! telemetryparse ! fakesink"
    )
    done = subprocess.run([*run, "--strict", text], check=False, capture_output=True, text=True, timeout=60)
    first, last = done.stderr.splitlines()
    assert first == f"warning: file: {video}: it holds no stream for the pad klv"
    assert last.startswith("5 frames in ")
    assert done.returncode == 1
