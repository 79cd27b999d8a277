import os
import sys
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from streamkit import ElementFailure, Frame, FrameFlags, MessageKind, Pipeline, raw_video_caps
from streamkit.testing import Harness


def ramp(number: int, size: tuple[int, int] = (64, 48)) -> Frame:
    """A moving grey ramp."""
    rows, columns = np.mgrid[: size[1], : size[0]]
    pixels = (40 + (rows + columns + 4 * number) % 160).astype(np.uint8)
    caps = raw_video_caps("GRAY8", *size, Fraction(25))
    return Frame(pixels, caps, pts=number * 40_000_000, duration=40_000_000, seq=number)


@pytest.mark.parametrize("codec", ["h264", "h265", "vp8", "vp9", "mpeg4", "mjpeg", "ffv1"])
def test_each_codec_comes_back(codec: str) -> None:
    """What is encoded decodes to the frames that went in, at their times, with their numbers."""
    with Harness("encode", codec=codec, quality=10, gop=8) as encoder, Harness("decode") as decoder:
        packets = [p for n in range(20) for p in encoder.push(ramp(n))] + encoder.drain()
        frames = [f for p in packets for f in decoder.push(p)] + decoder.drain()
    assert [frame.pts for frame in frames] == [n * 40_000_000 for n in range(20)]
    assert sum(bool(p.flags & FrameFlags.KEYFRAME) for p in packets) >= 3
    for number, frame in enumerate(frames):
        difference = frame.data.astype(float) - ramp(number).data
        assert np.median(np.abs(difference)) < 8
        assert abs(difference.mean()) < 2


@pytest.mark.parametrize("rate", [Fraction(10), Fraction(30000, 1001), None])
def test_frames_without_times_are_spaced_by_the_rate(tmp_path: Path, rate: Fraction | None) -> None:
    """As videofilesink does: 0, 11 and 22 us would be a video that nothing plays."""
    step_ns = round(10**9 / (rate or 25))
    caps = raw_video_caps("GRAY8", 64, 48, rate)
    path = tmp_path / "untimed.ts"
    with Harness("encode", live=True) as encoder, Harness("packetsink", location=str(path)) as sink:
        frames = [ramp(n).replace(pts=None, duration=None, caps=caps) for n in range(4)]
        frames.append(ramp(4).replace(pts=10**9, caps=caps))
        frames.append(frames[0])
        packets = [packet for frame in frames for packet in encoder.push(frame)] + encoder.drain()
        assert [packet.pts for packet in packets] == [
            *(number * step_ns for number in range(4)), 10**9, 10**9 + step_ns,
        ]  # fmt: skip
        for packet in packets:
            sink.push(packet)
        sink.drain()
    with av.open(str(path)) as container:
        times = [float(packet.pts * packet.time_base) for packet in container.demux(video=0) if packet.size]
    assert times == pytest.approx([packet.pts / 1e9 for packet in packets], abs=2e-5)


@pytest.mark.parametrize(("times", "count"), [((0, 0, 0), 1), ((80, 40, 0), 1), ((-80, -40, 0), 0)])
def test_times_that_do_not_ascend_are_warned_of(times: tuple[int, ...], count: int) -> None:
    """A second of video in 0.3 ms of a recording is not made in silence; times below 0 may ascend, too."""
    with Harness("encode", live=True) as encoder:
        for number, time in enumerate(times):
            encoder.push(ramp(number).replace(pts=time * 10**6))
    warnings = [message.text for message in encoder.messages if message.kind is MessageKind.WARNING]
    assert len(warnings) == count
    assert all("times do not ascend: a frame at 0.0" in text for text in warnings)


def test_frames_that_are_no_arrays_are_refused(tmp_path: Path) -> None:
    """Fakesrc gives bytes under any caps; the error says what was expected, and what came."""
    caps = "video/x-raw, format=GRAY8, width=64, height=48, framerate=25/1"
    for sink in ("encode ! fakesink", f"videofilesink location={tmp_path}/x.mp4"):
        with pytest.raises(
            ElementFailure, match=r"GRAY8 of 64 x 48 must be uint8\[48, 64\], got bytes; give"
        ):
            Pipeline.parse(f"fakesrc num-buffers=3 ! {caps} ! {sink}").run(timeout_s=20)


def test_live_holds_nothing_back() -> None:
    """Each frame's packet comes at once."""
    with Harness("encode", live=True) as encoder:
        assert [len(encoder.push(ramp(n))) for n in range(5)] == [1] * 5


def test_bit_rate_is_kept() -> None:
    """Noise at 200 kbit/s takes about 200 kbit for each second."""
    noise = np.random.default_rng(1)
    caps = raw_video_caps("GRAY8", 160, 120, Fraction(25))
    size = 0
    with Harness("encode", bitrate=200, live=True) as encoder:
        for number in range(100):
            pixels = noise.integers(0, 256, (120, 160)).astype(np.uint8)
            frames = encoder.push(Frame(pixels, caps, pts=number * 40_000_000))
            size += sum(len(bytes(frame.data)) for frame in frames)
    assert 0.7 < size * 8 / 4 / 200_000 < 1.4


@pytest.mark.parametrize("codec", ["h264", "h265", "av1", "vp8", "vp9", "mpeg4", "mjpeg"])
def test_quality_decides_the_size(codec: str) -> None:
    """Without bitrate a better quality takes more bytes, with every codec that loses any."""
    noise = np.random.default_rng(1)
    caps = raw_video_caps("GRAY8", 160, 128, Fraction(25))
    made = [noise.normal(128, 20, (128, 160)).clip(0, 255).astype(np.uint8) for _ in range(6)]
    sizes = []
    for quality in (10, 25, 40):
        with Harness("encode", codec=codec, quality=quality) as encoder:
            packets = [
                p for n, data in enumerate(made) for p in encoder.push(Frame(data, caps, pts=n * 40_000_000))
            ]
            sizes.append(sum(len(bytes(packet.data)) for packet in packets + encoder.drain()))
    assert sizes[0] > 1.5 * sizes[1] > 2 * sizes[2]


@pytest.mark.skipif(sys.platform != "linux", reason="reads the scheduling of threads")
@pytest.mark.parametrize("codec", ["h264", "h265", "av1", "vp9"])
def test_encoders_leave_the_scheduling_of_threads_alone(codec: str) -> None:
    """SVT-AV1 would give real-time priority to the whole process, where it may."""

    def policies() -> set[int]:
        return {os.sched_getscheduler(int(thread)) for thread in os.listdir("/proc/self/task")}

    with Harness("encode", codec=codec) as encoder:
        encoder.push(ramp(0))
        assert policies() == {os.SCHED_OTHER}
        encoder.drain()
    assert policies() == {os.SCHED_OTHER}


def test_a_new_size_begins_with_a_key_frame() -> None:
    """Frames of another size are encoded in it, the ones before are not lost."""
    with Harness("encode") as encoder:
        packets = [p for n in range(4) for p in encoder.push(ramp(n))]
        packets += [p for n in range(4, 8) for p in encoder.push(ramp(n, (96, 32)))] + encoder.drain()
    assert [p.caps["width"] for p in packets] == [64] * 4 + [96] * 4
    assert packets[4].flags & FrameFlags.KEYFRAME


def test_pixels_of_another_shape_than_the_caps_are_refused() -> None:
    """An array that is not what its caps say is an error that names both, and no stretched video."""
    frame = ramp(0).replace(data=np.zeros((10, 64), np.uint8))
    rule = r"GRAY8 of 64 x 48 must be uint8\[48, 64\], got uint8\[10, 64\]"
    with Harness("encode") as encoder, pytest.raises(ElementFailure, match=rule):
        encoder.push(frame)


def test_a_size_that_a_codec_does_not_take_is_named() -> None:
    """H.265 is of blocks of 8 px; FFmpeg says of smaller frames that the argument is invalid."""
    rule = r"h265 could not encode frames of 7 x 5 px: .*; another codec= or size may do"
    with Harness("encode", codec="h265") as harness, pytest.raises(ElementFailure, match=rule):
        harness.push(ramp(0, size=(7, 5)))


def test_odd_sizes_are_extended() -> None:
    """A frame of 33 x 21 becomes one of 34 x 22."""
    with Harness("encode", live=True) as encoder:
        (packet,) = encoder.push(ramp(0, (33, 21)))
    assert (packet.caps["width"], packet.caps["height"]) == (34, 22)


def test_frames_and_files(tmp_path: Path) -> None:
    """Jpegsink and multifilesink write numbered files; max-files keeps the newest."""
    text = f"videotestsrc num-buffers=5 ! jpegsink location={tmp_path}/a-%03d.jpg max-files=2"
    Pipeline.parse(text).run(timeout_s=20)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a-003.jpg", "a-004.jpg"]
    source = f"multifilesrc location={tmp_path}/a-%03d.jpg start-index=3"
    Pipeline.parse(f"{source} ! multifilesink location={tmp_path}/b-%d.jpg").run(timeout_s=20)
    assert (tmp_path / "b-1.jpg").read_bytes() == (tmp_path / "a-004.jpg").read_bytes()


@pytest.mark.parametrize("codec", ["h264", "h265", "av1", "vp9", "mpeg4"])
@pytest.mark.parametrize("count", range(60, 66))
def test_a_stop_leaves_no_hole(codec: str, count: int) -> None:
    """Whenever it comes, the packets that left are of the first frames, and the others are counted."""
    with Harness("encode", codec=codec) as harness:
        packets = [packet for number in range(count) for packet in harness.push(ramp(number))]
    assert sorted(packet.pts for packet in packets) == [n * 40_000_000 for n in range(len(packets))]
    missing = count - len(packets)
    assert harness.element.drops == ({"held by the encoder at the stop": missing} if missing else {})


def test_av1_prints_no_log(capfd: pytest.CaptureFixture[str]) -> None:
    """SVT-AV1 would print 17 lines of its settings."""
    with Harness("encode", codec="av1") as encoder:
        assert encoder.push(ramp(0)) + encoder.drain()
    assert capfd.readouterr().err == ""
