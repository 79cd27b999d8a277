import os
import random
import resource
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from av.codec.context import ThreadType

from streamkit import (
    Caps,
    DiscontinuityEvent,
    ElementFailure,
    Frame,
    FrameFlags,
    Message,
    MessageKind,
    NotNegotiated,
    Pipeline,
)
from streamkit.testing import Harness, ManualClock
from streamkit_media.codecs import coded_caps
from streamkit_media.decoding.decode import FIRST_FRAME_PACKETS, Decode
from streamkit_media.decoding.marks import Freshness
from streamkit_media.doctor.examine import examine
from streamkit_media.streams import DECODE_ONLY

MakeVideo = Callable[..., Path]
CONFORMANCE = Path("odd_media/corpus/h264")
DEEP_REORDERING = {"profile": "main", "x264-params": "b-adapt=0:b-pyramid=normal:ref=8"}


def packets_of(path: Path) -> list[Frame]:
    """The file's packets as filesrc gives them."""
    with Pipeline.parse(f'filesrc location="{path}" ! appsink name=out max-buffers=0') as pipeline:
        pipeline.play()
        return list(pipeline["out"])


def decoded(harness: Harness, packets: list[Frame]) -> list[Frame]:
    """Everything that comes out for these packets and EOS."""
    return [*(frame for packet in packets for frame in harness.push(packet)), *harness.drain()]


def test_real_video_decodes_to_its_luma_planes(streamkit_data: Path) -> None:
    """177 frames of real drone video are the decoder's luma planes: read-only views, equal to PyAV's own."""
    path = streamkit_data / "video" / "drone_nadir_traffic.mp4"
    count = 0
    with (
        av.open(str(path)) as container,
        Pipeline.parse(f"filesrc location={path} ! decode ! appsink name=out max-buffers=4") as pipeline,
    ):
        pipeline.play()
        for frame, video_frame in zip(pipeline["out"], container.decode(video=0), strict=True):
            assert frame.caps["format"] == "GRAY8"
            assert not frame.data.flags.writeable
            assert not frame.data.flags.owndata
            assert frame.data.strides == (video_frame.planes[0].line_size, 1)
            assert (frame.seq, frame.pts, frame.duration) == (count, count * 40_000_000, 40_000_000)
            if count % 8 == 0:
                luma = np.frombuffer(bytes(video_frame.planes[0]), np.uint8).reshape(1080, -1)[:, :1920]
                np.testing.assert_array_equal(frame.data, luma)
            count += 1
    assert count == 177


@pytest.mark.parametrize("is_stopped", [False, True])
def test_damaged_frames_are_counted_and_reported_once(clip: Path, tmp_path: Path, is_stopped: bool) -> None:
    """A transport stream that has lost 5 % of its packets ends with one warning, at EOS or a stop."""
    data, chance = clip.read_bytes(), random.Random(2)
    packets = [data[begin : begin + 188] for begin in range(0, len(data), 188)]
    lossy = tmp_path / "lossy.ts"
    lossy.write_bytes(b"".join(one for n, one in enumerate(packets) if n < 20 or chance.random() > 0.05))
    messages: list[Message] = []
    with Pipeline.parse(f"filesrc location={lossy} ! decode ! appsink name=out max-buffers=0") as pipeline:
        pipeline.bus.watch(messages.append)
        pipeline.play()
        frames = list(pipeline["out"]) if not is_stopped else [pipeline["out"].pull(5) for _ in range(60)]
        outcomes = pipeline["decode0"].outcomes
    damaged = sum(bool(frame.flags & FrameFlags.CORRUPT) for frame in frames)
    assert 0 < damaged <= outcomes["damaged"] < 100
    if not is_stopped:
        assert damaged == outcomes["damaged"]
    texts = [one.text for one in messages if one.source == "decode0" and one.is_shortfall]
    assert [text.partition(" of ")[0] for text in texts] == [str(outcomes["damaged"])]
    if not is_stopped:
        assert texts == [f"{damaged} of {len(frames)} frames are damaged"]


@pytest.mark.parametrize(
    ("name", "codec", "pixel_format"),
    [
        ("a.mp4", "libx264", "yuv420p"),
        ("b.mkv", "libx264", "yuv444p"),
        ("c.mkv", "libx264", "yuv420p10le"),
        ("d.mkv", "libx265", "yuv420p"),
        ("e.avi", "mpeg4", "yuv420p"),
        ("f.ts", "mpeg2video", "yuv420p"),
        ("g.webm", "libvpx", "yuv420p"),
        ("h.webm", "libvpx-vp9", "yuv420p"),
        ("i.avi", "mjpeg", "yuvj420p"),
        ("j.mkv", "ffv1", "yuv420p"),
        ("k.avi", "rawvideo", "yuv420p"),
        ("l.mov", "png", "rgb24"),
        ("m.avi", "msmpeg4", "yuv420p"),
    ],
)
def test_codecs_and_containers(make_video: MakeVideo, name: str, codec: str, pixel_format: str) -> None:
    """Every frame of each codec comes out, in order, with even times, and looks as it was made."""
    path = make_video(f"codec_{name}", codec=codec, pixel_format=pixel_format)
    with Pipeline.parse(f'filesrc location="{path}" ! decode ! appsink name=out') as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    assert [frame.seq for frame in frames] == list(range(12))
    assert np.diff([frame.pts for frame in frames]) == pytest.approx([40e6] * 11, abs=1e6)
    rows, columns = np.mgrid[:48, :64]
    has_full_range = pixel_format in ("rgb24", "yuvj420p")
    for index, frame in enumerate(frames):
        made = 40 + (rows + columns + 4 * index) % 160
        wanted = (made - 16) * 255 / 219 if has_full_range else made
        assert np.median(np.abs(frame.data.astype(float) - wanted)) < 6


@pytest.mark.parametrize(
    ("wanted", "shape"),
    [("GRAY8", (48, 64)), ("I420", (72, 64)), ("NV12", (72, 64)), ("BGR", (48, 64, 3)), ("RGB", (48, 64, 3))],
)
def test_downstream_chooses_the_format(small_video: Path, wanted: str, shape: tuple[int, ...]) -> None:
    """Each raw format is given where downstream asks for it, with size and rate in the caps."""
    text = f'filesrc location="{small_video}" ! decode ! video/x-raw,format={wanted} ! appsink name=out'
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    assert {frame.data.shape for frame in frames} == {shape}
    assert frames[0].caps["framerate"] == Fraction(25)
    assert (frames[0].caps["width"], frames[0].caps["height"]) == (64, 48)


def test_odd_sizes_keep_out_subsampled_formats() -> None:
    """A demand for I420 of a video of odd size fails before anything is decoded."""
    caps = coded_caps("h264", 33, 21)
    with (
        Harness("decode", downstream="video/x-raw, format=I420") as harness,
        pytest.raises(NotNegotiated, match="disagree on format"),
    ):
        harness.push(Frame(b"x", caps))


def test_odd_sizes_decode(make_video: MakeVideo) -> None:
    """A video of odd width and height gives GRAY8 and BGR in its own size."""
    path = make_video("odd.mkv", size=(64, 48), codec="ffv1", pixel_format="yuv444p", count=2)
    with av.open(str(path)) as container:
        packet = next(container.demux(video=0))
        caps = coded_caps("ffv1", 63, 47, packet.stream.codec_context.extradata or b"")
    for wanted, shape in (("GRAY8", (47, 63)), ("BGR", (47, 63, 3))):
        with Harness("decode", downstream=f"video/x-raw, format={wanted}") as harness:
            frames = decoded(harness, [Frame(packet, caps, flags=FrameFlags.KEYFRAME)])
        assert [frame.data.shape for frame in frames] == [shape]


def test_an_impossible_size_is_refused_before_decoding(small_video: Path) -> None:
    """Where downstream demands another size than that of the packets' caps, the error names the field."""
    text = f'filesrc location="{small_video}" ! decode ! video/x-raw,width=320 ! fakesink'
    with pytest.raises((ElementFailure, NotNegotiated), match="width"):
        Pipeline.parse(text).run(timeout_s=10)


def test_size_is_taken_from_the_first_frame_where_caps_have_none(small_video: Path) -> None:
    """Packets whose caps lack a size still decode; the frames' caps have it."""
    packets = packets_of(small_video)
    caps = packets[0].caps.without_fields("width", "height", "framerate")
    with Harness("decode") as harness:
        frames = decoded(harness, [packet.replace(caps=caps) for packet in packets])
    assert len(frames) == 12
    assert (frames[0].caps["width"], frames[0].caps["height"]) == (64, 48)
    assert frames[0].caps.get("framerate") is None


def test_missing_times_are_made_from_the_rate(small_video: Path) -> None:
    """Packets without times give frames at even times of the frame rate."""
    with Harness("decode") as harness:
        frames = decoded(harness, [p.replace(pts=None, duration=None) for p in packets_of(small_video)])
    assert [frame.pts for frame in frames] == [n * 40_000_000 for n in range(12)]


def _in_order_of_coding(path: Path) -> tuple[list[Frame], list[int]]:
    """The packets with times as of a writer that knows no B-frames, and the right times of the frames, ns."""
    packets = packets_of(path)
    times = sorted(packet.pts for packet in packets if packet.pts is not None)
    assert [packet.pts for packet in packets] != times, "the video has B-frames"
    return [packet.replace(pts=pts) for packet, pts in zip(packets, times, strict=True)], times


def test_times_in_order_of_coding_ascend_with_the_frames(make_video: MakeVideo) -> None:
    """Each frame has the time at which it is shown, from the first on; one warning says so."""
    packets, times = _in_order_of_coding(make_video("deep.mp4", count=40, bframes=3, options=DEEP_REORDERING))
    with Harness("decode") as harness:
        frames = decoded(harness, packets)
        warnings = [message.text for message in harness.messages if message.kind == "warning"]
    assert [frame.pts for frame in frames] == times
    assert [text for text in warnings if "order of coding" in text] == warnings
    assert len(warnings) == 1


def test_right_times_stay_with_their_frames_where_packets_are_lost(make_video: MakeVideo) -> None:
    """A lost packet leaves a gap in the times; no frame takes the place of another."""
    packets = packets_of(make_video("deep.mp4", count=40, bframes=3, options=DEEP_REORDERING))
    kept = [packet for number, packet in enumerate(packets) if number not in (9, 10, 22)]
    with Harness("decode") as harness:
        times = [frame.pts for frame in decoded(harness, kept)]
    assert set(times) <= {packet.pts for packet in kept}
    assert times == sorted(times, key=lambda pts: pts or 0)


def test_damaged_packets_are_counted_and_reported_once(small_video: Path) -> None:
    """Undecodable packets give one warning and are all counted; the others decode."""
    packets = packets_of(small_video)
    rubbish = packets[0].replace(data=b"\xff" * 100, flags=FrameFlags.NONE, seq=1000)
    with Harness(Decode(threads_type="slice")) as harness:
        frames = decoded(harness, [rubbish, *packets, rubbish, rubbish])
        drops = dict(harness.element.drops)
    assert len(frames) == 12
    assert [m.text for m in harness.messages if m.kind == "warning"] == [
        "a packet could not be decoded at frame seq=1000 pts=0.000 s: Invalid data found when "
        "processing input; continuing with the next",
        "2 of 12 frames are damaged",  # those that the decoder held when the last rubbish came
    ]
    assert drops == {"undecodable packet: Invalid data found when processing input": 3}


@pytest.mark.parametrize(("flags", "warnings"), [("+ildct+ilme", 1), ("+bitexact", 0)])
def test_interlaced_video_is_warned_of_once(make_video: MakeVideo, flags: str, warnings: int) -> None:
    """Its frames come out as they are: two half images, of two times."""
    path = make_video(f"fields{warnings}.mpg", codec="mpeg2video", options={"flags": flags}, count=5)
    with Harness("decode") as harness:
        assert len(decoded(harness, packets_of(path))) == 5
    warned = [message.text for message in harness.messages if message.kind == "warning"]
    assert [text.partition(",")[0] for text in warned] == ["the video is interlaced"] * warnings


@pytest.mark.parametrize(("ratio", "warnings"), [("16/15", 1), ("1/1", 0), ("400/401", 0)])
def test_pixels_that_are_not_square_are_warned_of_once(
    make_video: MakeVideo, ratio: str, warnings: int
) -> None:
    """The rest of the pipeline takes them for square: a position on the ground would be off in silence."""
    name, options = f"pixels{ratio.replace('/', '-')}.mp4", {"x264-params": f"sar={ratio}"}
    path = make_video(name, options=options, count=5)
    with Harness("decode") as harness:
        assert len(decoded(harness, packets_of(path))) == 5
    warned = [message.text for message in harness.messages if message.kind == "warning"]
    assert [text.partition(",")[0] for text in warned] == (
        ["the pixels of the video are not square (16:15)"] * warnings
    )
    notes = [check.text for check in examine(str(path), 1.0, 5.0, "tcp", lambda _: None).checks]
    assert sum("not square (16:15)" in text for text in notes) == warnings


def test_a_stream_joined_between_keyframes_says_what_it_waits_for(make_video: MakeVideo) -> None:
    """Its parameter sets come with the next keyframe; until then nothing decodes, which is no damage."""
    packets = packets_of(make_video("joined.ts", bframes=0, options={"g": "6", "sc_threshold": "0"}))[1:]
    caps = packets[0].caps.without_fields("codec_data", "width", "height")
    with Harness(Decode(threads_type="slice")) as harness:
        frames = decoded(harness, [packet.replace(caps=caps) for packet in packets])
        drops = dict(harness.element.drops)
    assert len(frames) == 6
    assert drops == {"undecodable packet: no keyframe has come yet": 5}
    (warning,) = [message.text for message in harness.messages if message.kind == "warning"]
    assert "no keyframe has come yet; continuing with the next" in warning


def test_parameter_sets_that_never_come_are_named(make_video: MakeVideo) -> None:
    """Of a live stream of H.265 that was joined late nothing was said: FFmpeg reports no error."""
    packets = packets_of(make_video("late.ts", codec="libx265"))[1:]
    caps = packets[0].caps.without_fields("codec_data", "width", "height")
    with Harness(Decode()) as harness:
        for number in range(FIRST_FRAME_PACKETS + 20):
            harness.push(packets[number % len(packets)].replace(caps=caps))
        texts = [message.text for message in harness.messages if message.kind == "warning"]
    (text,) = [text for text in texts if "have given no frame" in text]
    assert text.startswith("100 packets of video/x-h265 have given no frame")
    assert "have the sender repeat them, as GStreamer's h265parse config-interval=-1" in text


def test_frames_of_a_lost_key_frame_are_marked(small_video: Path) -> None:
    """Frames whose reference is missing come out marked corrupt, those after the next keyframe whole."""
    packets = packets_of(small_video)[1:]
    with Harness(Decode(threads_type="slice")) as harness:
        frames = decoded(harness, packets)
    marks = [bool(frame.flags & FrameFlags.CORRUPT) for frame in frames]
    assert not any(marks[-6:])
    assert all(marks[:-6])
    assert sum(bool(frame.flags & FrameFlags.KEYFRAME) for frame in frames) == 1


def test_nothing_decodable_is_an_error(small_video: Path) -> None:
    """Where not one packet decodes, EOS turns into an error with the count and the reason."""
    packets = packets_of(small_video)
    with Harness(Decode(threads_type="slice")) as harness:
        for packet in packets:
            assert harness.push(packet.replace(data=b"\xff" * 50)) == []
        with pytest.raises(
            ElementFailure, match=r"none of 12 packets of video/x-h264 could be decoded: Invalid"
        ):
            harness.drain()


def test_a_limit_of_memory_is_named_as_a_cause(small_video: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """FFmpeg calls large frames for which there is no memory invalid data."""
    monkeypatch.setattr(resource, "getrlimit", lambda _: (300 << 20, 300 << 20))
    with Harness("decode") as harness:
        harness.push(packets_of(small_video)[0].replace(data=b"\xff" * 50))
        with pytest.raises(ElementFailure, match=r"or cut short, or memory-mb= is too low for its frames"):
            harness.drain()


def test_empty_packets_are_counted(small_video: Path) -> None:
    """An empty packet, which FFmpeg would take for the end, is counted and skipped."""
    packets = packets_of(small_video)
    with Harness("decode") as harness:
        frames = decoded(harness, [packets[0], packets[0].replace(data=b""), *packets[1:]])
        assert harness.element.drops == {"empty packet": 1}
    assert len(frames) == 12


def test_a_new_size_in_mid_stream(small_video: Path, make_video: MakeVideo) -> None:
    """New caps first bring out all frames of the old size, then frames with the new one."""
    other = packets_of(make_video("wide.mp4", size=(96, 48)))
    with Harness("decode") as harness:
        frames = decoded(harness, [*packets_of(small_video), *other])
    assert [frame.data.shape[1] for frame in frames] == [64] * 12 + [96] * 12
    assert [frame.caps["width"] for frame in frames] == [64] * 12 + [96] * 12


def test_a_new_epoch_begins_a_new_decoder(small_video: Path) -> None:
    """Frames held from before a discontinuity come out with their own epoch, before the new ones."""
    packets = packets_of(small_video)
    with Harness("decode") as harness:
        frames = decoded(harness, [*packets, *(packet.replace(epoch=1) for packet in packets)])
    assert [frame.epoch for frame in frames] == [0] * 12 + [1] * 12


def test_held_frames_leave_before_a_discontinuity(small_video: Path) -> None:
    """After it, sinks take them for frames outside the stream, whose new segment begins later."""
    packets = packets_of(small_video)
    with Harness("decode") as harness:
        before = [frame for packet in packets for frame in harness.push(packet)]
        held = harness.send(DiscontinuityEvent(1))
        after = decoded(harness, [packet.replace(epoch=1) for packet in packets])
    assert held
    assert [frame.epoch for frame in [*before, *held]] == [0] * 12
    assert [frame.epoch for frame in after] == [1] * 12


def test_packets_only_for_decoding_are_not_shown(small_video: Path) -> None:
    """Frames of packets marked for decoding alone are left out, the rest are whole."""
    packets = packets_of(small_video)
    marked = [packet.attach(DECODE_ONLY) if packet.pts < 120_000_000 else packet for packet in packets]
    with Harness("decode") as harness:
        frames = decoded(harness, marked)
    assert [frame.pts for frame in frames] == [n * 40_000_000 for n in range(3, 12)]
    assert not any(frame.flags & FrameFlags.CORRUPT for frame in frames)


def test_live_frames_that_have_waited_are_left_out(make_video: MakeVideo) -> None:
    """A frame later than others by more than the slack is dropped for the newest one, and counted."""
    packets = packets_of(make_video("live.mp4", bframes=0))
    clock, shown = ManualClock(), []
    with Harness(Decode(threads=1, threads_type="slice"), clock=clock) as harness:
        for index, packet in enumerate(packets):
            live = packet.replace(arrival_ns=clock.monotonic_ns()).attach(Freshness(100_000_000))
            clock.advance(0.5 if index % 3 == 2 else 0.02)
            shown += harness.push(live)
        shown += harness.drain()
        drops = dict(harness.element.drops)
    assert [frame.seq for frame in shown] == [0, 1, 4, 7, 10]
    assert drops == {"late: too old when decoded": 7}


def test_live_frames_that_are_reordered_have_not_waited(make_video: MakeVideo) -> None:
    """A frame that is shown after later packets is as new as the packet that lets it be shown."""
    packets = packets_of(make_video("reordered.mp4", count=60, bframes=3))
    clock, shown = ManualClock(), []
    with Harness(Decode(threads=1, threads_type="slice"), clock=clock) as harness:
        for packet in packets:
            live = packet.replace(arrival_ns=clock.monotonic_ns()).attach(Freshness(100_000_000))
            shown += harness.push(live)
            clock.advance(0.04)
        shown += harness.drain()
        assert not harness.element.drops
    assert [frame.seq for frame in shown] == list(range(60))


def test_numbers_that_come_with_frames_stay_with_them(make_video: MakeVideo) -> None:
    """An encoder numbers its packets as their frames, which come out in another order."""
    packets = packets_of(make_video("numbered.mp4", count=30, bframes=3))
    ascending = sorted(packets, key=lambda packet: packet.pts)
    numbered = [packet.replace(seq=100 + ascending.index(packet)) for packet in packets]
    assert [packet.seq for packet in numbered] != list(range(100, 130))
    with Harness("decode") as harness:
        frames = decoded(harness, numbered)
    assert [frame.seq for frame in frames] == list(range(100, 130))


@pytest.mark.parametrize("threads", [1, 6])
@pytest.mark.parametrize("failing", [(7,), (9, 20), (5, 6, 21)])
def test_frames_keep_their_numbers_where_packets_fail(
    make_video: MakeVideo, threads: int, failing: tuple[int, ...]
) -> None:
    """The number of a frame is its place in the video, also behind one that is lost and in other threads."""
    packets = packets_of(make_video("failing.mp4", count=60, bframes=3, options={"g": "60"}))
    for index in failing:
        packets[index] = packets[index].replace(data=b"\x7f\xff\xff\xff" + bytes(packets[index].data)[4:])
    with Harness(Decode(threads=threads)) as harness:
        frames = decoded(harness, packets)
    assert len(frames) == 60 - len(failing)
    assert [frame.seq for frame in frames] == [round((frame.pts or 0) / 40_000_000) for frame in frames]


def test_a_failing_packet_of_the_time_of_another_takes_no_number(make_video: MakeVideo) -> None:
    """As the second field of a frame, or a part of a packet that is sent twice."""
    packets = packets_of(make_video("twice.mp4", count=30, bframes=0, options={"g": "60"}))
    part = packets[9].replace(data=b"\x7f\xff\xff\xff", seq=10)
    later = [packet.replace(seq=packet.seq + 1) for packet in packets[10:]]
    with Harness(Decode(threads=1)) as harness:
        frames = decoded(harness, [*packets[:10], part, *later])
    assert [frame.seq for frame in frames] == [number for number in range(31) if number != 10]


def test_a_decoder_that_is_always_late_shows_all_the_same(make_video: MakeVideo) -> None:
    """Where every frame takes half a second, they are shown after a moment rather than never."""
    packets = packets_of(make_video("slow.mp4", count=60, bframes=0))
    clock, shown = ManualClock(), 0
    with Harness(Decode(threads=1, threads_type="slice"), clock=clock) as harness:
        for packet in packets:
            live = packet.replace(arrival_ns=clock.monotonic_ns()).attach(Freshness(100_000_000))
            clock.advance(0.5)
            shown += len(harness.push(live))
        assert shown + harness.element.drops["late: too old when decoded"] == 60
    assert shown > 20


def test_a_discontinuity_of_a_hidden_frame_is_the_next_ones(small_video: Path) -> None:
    """The mark moves to the first frame after it that is shown, also over other hidden ones."""
    first, second, *others = packets_of(small_video)
    first = first.replace(flags=first.flags | FrameFlags.DISCONTINUITY)
    packets = [first.attach(DECODE_ONLY), second.attach(DECODE_ONLY), *others]
    with Harness(Decode(threads=1, threads_type="slice")) as harness:
        frames = decoded(harness, packets)
    assert len(frames) == 10
    assert [bool(frame.flags & FrameFlags.DISCONTINUITY) for frame in frames] == [True] + [False] * 9


def test_damage_of_a_hidden_frame_marks_those_built_on_it(make_video: MakeVideo) -> None:
    """A damaged frame that is not shown still leaves the next ones damaged, up to a keyframe."""
    packets = packets_of(make_video("hidden.mp4", bframes=0))
    packets[2] = packets[2].replace(flags=FrameFlags.CORRUPT).attach(DECODE_ONLY)
    with Harness(Decode(threads=1, threads_type="slice")) as harness:
        frames = decoded(harness, packets)
    marks = [bool(frame.flags & FrameFlags.CORRUPT) for frame in frames]
    assert marks == [False] * 2 + [True] * 3 + [False] * 6


def test_frames_after_one_that_is_missing_are_marked(make_video: MakeVideo) -> None:
    """A frame lost whole, of which FFmpeg says nothing, leaves those up to the next keyframe marked."""
    packets = packets_of(make_video("missing.mp4", bframes=0))
    with Harness("decode") as harness:
        frames = decoded(harness, [packet for packet in packets if packet.seq != 7])
    assert {frame.seq: bool(frame.flags & FrameFlags.CORRUPT) for frame in frames} == {
        seq: seq in (8, 9, 10, 11) for seq in range(12) if seq != 7
    }


def test_arrival_and_capture_follow_the_frame(small_video: Path) -> None:
    """Arrival and capture time of a packet are on its own frame, in any order of decoding."""
    packets = [packet.replace(arrival_ns=1000 + packet.pts) for packet in packets_of(small_video)]
    with Harness("decode") as harness:
        frames = decoded(harness, packets)
    assert [frame.arrival_ns - 1000 for frame in frames] == [frame.pts for frame in frames]


def test_a_codec_without_decoder_is_reported() -> None:
    """Caps of a codec that FFmpeg cannot decode give an error with the remedy."""
    with (
        Harness("decode") as harness,
        pytest.raises(ElementFailure, match=r"no decoder in this FFmpeg for video/x-coded.*nosuch.*H\.264"),
    ):
        harness.push(Frame(b"x", coded_caps("nosuch")))


def test_slice_threads_are_taken_when_live(small_video: Path) -> None:
    """threads-type=auto looks through queues for the source: slices when that is live, else whole frames."""
    live = Pipeline.parse("rtspsrc location=rtsp://127.0.0.1:1/x ! queue ! decode name=d ! fakesink")["d"]
    file = Pipeline.parse(f'filesrc location="{small_video}" ! decode name=d ! fakesink')["d"]
    caps = coded_caps("h264", 64, 48)
    assert (live._threads("h264", caps)[0], file._threads("h264", caps)[0]) == (
        ThreadType.SLICE,
        ThreadType.FRAME,
    )


def test_packets_at_the_end_that_give_no_frame_are_named(make_video: MakeVideo) -> None:
    """As where a tool has joined recordings of two codecs, and moved their times."""
    packets = packets_of(make_video("first.mp4", 40))
    others = [packet.data for packet in packets_of(make_video("second.mp4", 40, codec="mpeg4"))]
    joined = packets[:20] + [
        packet.replace(data=data) for packet, data in zip(packets[20:], others, strict=False)
    ]
    with Harness("decode") as harness:
        assert decoded(harness, joined)
        texts = {message.text: message.fields.get("code") for message in harness.messages}
    (lost,) = [text for text in texts if "packets gave no frame, from frame seq=2" in text]
    assert "where recordings of different codecs are joined, read them one by one" in lost
    assert texts[lost] == "shortfall"


def test_frames_cost_no_copy_of_pixels(make_video: MakeVideo) -> None:
    """Holding frames holds the decoder's frames, each at its own address."""
    path = make_video("many.mp4", count=30)
    with Pipeline.parse(f'filesrc location="{path}" ! decode ! appsink name=out max-buffers=0') as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    assert len({frame.data.ctypes.data for frame in frames}) == 30
    assert len({frame.data[:8, :8].tobytes() for frame in frames}) == 30


def test_stopping_early_is_quick(streamkit_data: Path) -> None:
    """A pipeline stopped amid decoding ends at once."""
    path = streamkit_data / "video" / "drone_nadir_traffic.mp4"
    pipeline = Pipeline.parse(f"filesrc location={path} ! decode ! appsink name=out max-buffers=2")
    pipeline.play()
    pipeline["out"].pull(30)
    began = time.monotonic()
    pipeline.stop()
    assert time.monotonic() - began < 5


@pytest.mark.parametrize(("skip", "shown"), [("none", 12), ("non-reference", range(4, 11)), ("non-key", 2)])
def test_skipped_frames_are_counted(make_video: MakeVideo, skip: str, shown: int | range) -> None:
    """Fewer frames come out, right ones and in order, and the others count as dropped."""
    path = make_video("small_for_skip.mp4")
    whole = {frame.pts: frame.data for frame in _all_frames(path, "none")[0]}
    frames, drops = _all_frames(path, skip)
    assert len(frames) in ([shown] if isinstance(shown, int) else shown)
    assert len(frames) + drops.get(f"skip={skip}", 0) == 12
    assert [frame.pts for frame in frames] == sorted(frame.pts for frame in frames)
    for frame in frames:
        np.testing.assert_array_equal(frame.data, whole[frame.pts])


def _all_frames(path: Path, skip: str) -> tuple[list[Frame], dict[str, int]]:
    text = f"filesrc location={path} ! decode name=d skip={skip} ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        return list(pipeline["out"]), dict(pipeline["d"].drops)


@pytest.mark.parametrize(
    ("degrees", "is_mirrored"), [(90, False), (180, False), (270, False), (0, True), (90, True)]
)
@pytest.mark.parametrize("pixel_format", ["GRAY8", "I420", "NV12"])
def test_frames_are_turned(tmp_path: Path, degrees: int, pixel_format: str, *, is_mirrored: bool) -> None:
    """A file that says its frames are to be rotated or mirrored gives them so; size and caps match."""
    path = tmp_path / "turned.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"crf": "5"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.set_display_rotation(degrees, hflip=is_mirrored)
        pixels = np.full((72, 64), 128, np.uint8)
        pixels[:48] = 60
        pixels[:16, :16] = 220
        video_frame = av.VideoFrame.from_ndarray(pixels, "yuv420p")
        container.mux(stream.encode(video_frame))
        container.mux(stream.encode(None))
    text = f"filesrc location={path} ! decode ! video/x-raw, format={pixel_format} ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        (frame,) = list(pipeline["out"])
    wanted = np.rot90(pixels[:48], degrees // 90)
    wanted = wanted[:, ::-1] if is_mirrored else wanted
    height, width = wanted.shape
    assert frame.data.shape == (height if pixel_format == "GRAY8" else height * 3 // 2, width)
    assert (frame.caps["width"], frame.caps["height"]) == (width, height)
    assert np.abs(frame.data[:height].astype(int) - wanted).mean() < 5


def test_the_decoder_in_use_is_reported(small_video: Path) -> None:
    """An element message says whether a device or software decodes."""
    with Pipeline.parse(f"filesrc location={small_video} ! decode hwaccel=none ! fakesink") as pipeline:
        pipeline.play()
        message = pipeline.bus.pop(5, (MessageKind.ELEMENT,))
    assert message is not None
    assert message.fields == {"name": "decoder", "codec": "h264", "device": "software"}


def _conformance_streams() -> list[str]:
    folder = Path(os.environ.get("STREAMKIT_DATA", "")) / "data" / CONFORMANCE
    return sorted(path.name for path in folder.iterdir()) if folder.is_dir() else ["none"]


@pytest.mark.parametrize("name", _conformance_streams())
def test_every_packet_of_a_conformance_stream_gives_a_frame(streamkit_data: Path, name: str) -> None:
    """As many frames come out of a file of H.264 as packets go in."""
    path = streamkit_data / CONFORMANCE / name
    frames, drops = _all_frames(path, "none")
    assert len(packets_of(path)) == len(frames) > 0
    assert drops == {}


def test_h264_that_does_not_declare_its_reordering_loses_nothing(make_video: MakeVideo) -> None:
    """A file of deeply reordered H.264 without VUI gives every frame, in order of presentation."""
    packets, caps = _unordered(make_video("deep.mkv", count=40, bframes=8, options=DEEP_REORDERING))
    with Harness("decode") as harness:
        frames = decoded(harness, [packet.replace(caps=caps) for packet in packets])
        assert harness.element.drops == {}
    assert [frame.pts for frame in frames] == sorted(packet.pts for packet in packets)


def test_a_live_decoder_does_not_hold_frames_for_their_order(make_video: MakeVideo) -> None:
    """Of H.264 without VUI a live decoder gives frames as soon as it can; a file's waits for their order."""
    packets, caps = _unordered(make_video("deep.mkv", count=40, bframes=8, options=DEEP_REORDERING))
    shown = []
    for source in ("rtspsrc location=rtsp://127.0.0.1:1/x", "fakesrc"):
        element = Pipeline.parse(f"{source} ! decode name=d threads=1 threads-type=slice ! fakesink")["d"]
        element.start()
        found = [element.transform(packet.replace(caps=caps)) for packet in packets[:12]]
        shown.append(sum(1 if isinstance(each, Frame) else len(each) for each in found))
        element.stop()
    live, file = shown
    assert live > 0 == file


def _unordered(path: Path) -> tuple[list[Frame], Caps]:
    """A file's packets, and their caps with parameter sets that do not declare the depth of reordering."""
    packets = packets_of(path)
    codec_data = bytes.fromhex(str(packets[0].caps["codec_data"]))
    size = int.from_bytes(codec_data[6:8], "big")
    parameters = _without_vui(codec_data[8 : 8 + size])
    codec_data = codec_data[:6] + len(parameters).to_bytes(2, "big") + parameters + codec_data[8 + size :]
    return packets, packets[0].caps.with_fields(codec_data=codec_data.hex())


def _without_vui(unit: bytes) -> bytes:
    """A sequence parameter set of the main profile, its usability information cut off (H.264, 7.3.2.1.1)."""
    bits = "".join(f"{byte:08b}" for byte in unit.replace(b"\0\0\3", b"\0\0"))
    at = 8 + 24

    def unsigned() -> int:
        nonlocal at
        zeros = bits.index("1", at) - at
        at += 2 * zeros + 1
        return int(bits[at - zeros - 1 : at], 2) - 1

    unsigned()  # number
    unsigned()  # bits of frame numbers
    assert unsigned() == 0  # type of frame order count
    unsigned()
    unsigned()  # reference frames
    at += 1
    unsigned()  # width
    unsigned()  # height
    at += 2  # whole frames only, direct inference
    at += 1
    for _ in range(4 if bits[at - 1] == "1" else 0):
        unsigned()  # cropping
    assert bits[at] == "1"
    kept = bits[:at] + "01"
    kept += "0" * (-len(kept) % 8)
    return int(kept, 2).to_bytes(len(kept) // 8, "big")


def test_packets_without_a_frame_are_counted(make_video: MakeVideo) -> None:
    """Each damaged packet is a frame or counted, for every type of threads."""
    packets = packets_of(make_video("counted.mkv", count=40))
    for threads_type in ("frame", "slice"):
        for seed in range(10):
            chance = random.Random(seed)
            damaged = [
                packet.replace(data=bytes(packet.data)[: chance.randrange(1, 9)])
                if chance.random() < 0.2
                else packet
                for packet in packets
            ]
            with Harness(Decode(threads_type=threads_type)) as harness:
                frames = decoded(harness, damaged)
                assert len(frames) + sum(harness.element.drops.values()) == 40
