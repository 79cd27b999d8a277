import itertools
import json
import random
import re
import resource
import shutil
import socket
import threading
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from streamkit import ElementFailure, Frame, FrameFlags, Message, MessageKind, Pipeline, Pose
from tests.frames import frames_of
from tests.slowness import patience

MakeVideo = Callable[..., Path]


def decoded(location: object, properties: str = "") -> list[Frame]:
    """All frames of a file, decoded."""
    return frames_of(f'filesrc location="{location}" {properties} ! decode')


def _several_videos(path: Path, count: int) -> None:
    """Writes a file of some videos, grey of 50, 100, ..."""
    with av.open(str(path), "w") as container:
        streams = [container.add_stream("mpeg4", 25, width=64, height=48) for _ in range(count)]
        for number in range(5):
            for index, stream in enumerate(streams, 1):
                frame = av.VideoFrame.from_ndarray(np.full((72, 64), 50 * index, np.uint8), "yuv420p")
                frame.pts = number
                container.mux(stream.encode(frame))
        for stream in streams:
            container.mux(stream.encode(None))


@pytest.mark.parametrize("index", [0, 1, 2])
def test_the_video_to_read_is_chosen(tmp_path: Path, index: int) -> None:
    """As of a drone with a thermal camera beside the other; a number that is none says which there are."""
    path = tmp_path / "two.mkv"
    _several_videos(path, 2)
    text = f'filesrc location="{path}" video-stream={index} ! decode ! appsink name=out'
    with Pipeline.parse(text) as pipeline:
        if index == 2:
            with pytest.raises(ElementFailure, match="stream 2 is no video; videos are 0, 1"):
                pipeline.play()
            return
        pipeline.play()
        frames = list(pipeline["out"])
        assert pipeline.bus.pop(0, (MessageKind.WARNING,)) is None
    assert [int(frame.data.mean().round(-1)) for frame in frames] == [50 * (index + 1)] * 5


@pytest.mark.parametrize("count", [1, 2])
def test_a_video_that_is_not_read_is_named(tmp_path: Path, count: int) -> None:
    """A camera's second picture, or a second program, would be missed in silence."""
    path = tmp_path / "two.mkv"
    _several_videos(path, count)
    pipeline = Pipeline.parse(f'filesrc location="{path}" ! fakesink')
    messages: list[Message] = []
    pipeline.bus.watch(messages.append)
    pipeline.run(timeout_s=patience(20))
    warnings = [message.text for message in messages if message.kind is MessageKind.WARNING]
    assert [text.removeprefix(str(path)).partition(";")[0] for text in warnings] == (
        [": video stream 0 is read, and not [1]"] if count == 2 else []
    )


def test_packets_carry_caps_times_and_marks(small_video: Path) -> None:
    """Filesrc gives every packet with fixed caps, in decoding order."""
    with Pipeline.parse(f'filesrc location="{small_video}" ! appsink name=out') as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    assert len(frames) == 12
    assert str(frames[0].caps).startswith(
        "video/x-h264, width=(int)64, height=(int)48, framerate=(fraction)25/1"
    )
    assert sorted(frame.pts for frame in frames) == [n * 40_000_000 for n in range(12)]
    assert frames[0].pts == 0
    assert [frame.seq for frame in frames] == list(range(12))


@pytest.mark.parametrize("rate", [Fraction(30000, 1001), Fraction(24), Fraction(10)])
def test_times_are_exact(make_video: MakeVideo, rate: Fraction) -> None:
    """Each frame's time is its number over the rate, to the nanosecond."""
    path = make_video(f"rate_{rate.numerator}.mp4", rate=rate, count=40)
    assert [frame.pts for frame in decoded(path)] == [round(n * 10**9 / rate) for n in range(40)]


@pytest.mark.parametrize(
    ("properties", "first", "end"),
    [
        ("start-s=0.2", 5, 12),
        ("start-s=0.28", 7, 12),
        ("stop-s=0.2", 0, 5),
        ("start-s=0.12 stop-s=0.36", 3, 9),
    ],
)
def test_start_and_stop_are_exact_to_the_frame(
    small_video: Path, properties: str, first: int, end: int
) -> None:
    """Only frames from start-s to before stop-s are shown, and those are as they were in the whole video."""
    whole, part = decoded(small_video), decoded(small_video, properties)
    assert [frame.pts for frame in part] == [n * 40_000_000 for n in range(first, end)]
    for frame, same in zip(part, whole[first:end], strict=True):
        np.testing.assert_array_equal(frame.data, same.data)


@pytest.mark.parametrize(
    ("name", "codec"),
    [("far.ts", "libx264"), ("far2.ts", "mpeg2video"), ("far.mpg", "mpeg2video"), ("far.mp4", "libx264")],
)
def test_a_start_far_from_a_keyframe_is_exact(make_video: MakeVideo, name: str, codec: str) -> None:
    """A container without an index is entered between keyframes, here 4 s apart; all frames are whole."""
    path = make_video(name, count=300, codec=codec, options={"g": "100", "sc_threshold": "1000000000"})
    whole = decoded(path)
    for first in (10, 130, 199, 200, 260):
        part = decoded(path, f"start-s={first / 25}")
        assert [frame.pts for frame in part] == [frame.pts for frame in whole[first:]], first
        assert not any(frame.flags & FrameFlags.CORRUPT for frame in part), first
        for frame, same in zip(part, whole[first:], strict=True):
            np.testing.assert_array_equal(frame.data, same.data, err_msg=f"start at frame {first}")


def test_a_start_beyond_the_end_gives_nothing(small_video: Path) -> None:
    """A start-s after the last frame ends at once with a warning, without error."""
    text = f'filesrc location="{small_video}" start-s=60 ! decode ! appsink name=out'
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert list(pipeline["out"]) == []
        warning = pipeline.bus.pop(5, (MessageKind.WARNING,))
    assert warning is not None
    assert warning.text == f"{small_video}: there is no frame from start-s=60 on; it is 0.5 s long"


@pytest.mark.parametrize(
    ("name", "codec"), [("still.png", "png"), ("still.jpg", "mjpeg"), ("still.bmp", "bmp")]
)
def test_a_still_frame_is_a_stream_of_one_frame(tmp_path: Path, name: str, codec: str) -> None:
    """A frame file gives one frame."""
    video_frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 90, np.uint8), "rgb24")
    encoder = av.CodecContext.create(codec, "w")
    encoder.width, encoder.height, encoder.time_base = 64, 48, Fraction(1, 25)
    encoder.pix_fmt = {"png": "rgb24", "mjpeg": "yuvj420p", "bmp": "bgr24"}[codec]
    packets = encoder.encode(video_frame.reformat(format=encoder.pix_fmt)) + encoder.encode(None)
    (tmp_path / name).write_bytes(b"".join(bytes(packet) for packet in packets))
    (frame,) = decoded(tmp_path / name)
    assert frame.data.shape == (48, 64)
    assert abs(int(frame.data[10, 10]) - 90) <= 2


@pytest.mark.parametrize(
    ("properties", "rule"),
    [
        ("", "location= must name a file, it is empty"),
        ("location=/nosuch/flight.mp4", "/nosuch/flight.mp4: a file must be there, none is"),
        ("location=img/%03d.png", "numbered images are read by multifilesrc"),
        ("location=/", "a file is needed, this is a directory"),
        ("location=x.mp4 start-s=3 stop-s=2", "stop-s= must be after start-s=3, got 2"),
    ],
)
def test_bad_locations_fail_before_playing(properties: str, rule: str) -> None:
    """What can be known is known when the element starts."""
    pipeline = Pipeline.parse(f"filesrc {properties} ! decode ! fakesink")
    with pytest.raises(ElementFailure, match=rule):
        pipeline.ready()
    pipeline.stop()


def test_a_truncated_file_gives_its_complete_frames(make_video: MakeVideo, tmp_path: Path) -> None:
    """A file whose end is missing gives its whole frames and then EOS, or an error; it never hangs."""
    data = make_video("long.mkv", count=60).read_bytes()
    path = tmp_path / "cut.mkv"
    path.write_bytes(data[: len(data) * 2 // 3])
    frames = decoded(path)
    assert 20 < len(frames) < 60


@pytest.mark.parametrize("name", ["cut.mp4", "cut.mov"])
def test_a_packet_that_the_end_cuts_costs_no_other_frame(
    make_video: MakeVideo, tmp_path: Path, name: str
) -> None:
    """A decoder with many threads refuses its part, and would lose the frames that other threads hold."""
    data = make_video(name, count=60, container_options={"movflags": "faststart"}).read_bytes()
    path = tmp_path / name
    path.write_bytes(data[:-20])
    with Pipeline.parse(f"filesrc location={path} ! decode threads=8 ! appsink name=out") as pipeline:
        pipeline.play()
        times = [frame.pts for frame in pipeline["out"]]
        warnings = []
        while (message := pipeline.bus.pop(0.0, (MessageKind.WARNING,))) is not None:
            warnings.append(message.text)
    assert (len(times), times) == (59, sorted(times))
    assert warnings == [f"{path}: the file ends within a packet, which is left out"]


@pytest.mark.parametrize("name", ["whole.mp4", "whole.mkv", "whole.avi"])
@pytest.mark.parametrize(
    ("part", "properties", "is_reported"),
    [
        (1, "", False),
        (0.5, "", True),
        (0.5, "start-s=0.5", True),
        (0.5, "start-s=4.5", True),
        (0.5, "stop-s=1", False),
        (0.5, "loop=true", True),
    ],
)
def test_a_file_that_is_cut_short_is_reported(
    make_video: MakeVideo, tmp_path: Path, name: str, part: float, properties: str, is_reported: bool
) -> None:
    """Where the video ends clearly before the declared end, one shortfall says where it does and should."""
    codec = "mpeg4" if name.endswith("avi") else "libx264"
    options = {"movflags": "faststart"}
    data = make_video(name, count=150, codec=codec, container_options=options).read_bytes()
    path = tmp_path / name
    path.write_bytes(data[: round(len(data) * part)])
    texts = []
    text = f'filesrc location="{path}" {properties} ! decode ! appsink name=out max-buffers=0'
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        for count, _ in enumerate(pipeline["out"]):
            if count == 160:
                break
        while (message := pipeline.bus.pop(0.0)) is not None:
            if message.fields.get("code") == "shortfall":
                texts.append(message.text)
    rule = rf"{re.escape(str(path))}: the video ends (at|before) [1-4]\.\d s of 6\.0 s: the file is cut short"
    assert len(texts) == is_reported
    assert all(re.fullmatch(rule, text) for text in texts)


@pytest.mark.parametrize("part", [1.0, 0.5])
def test_a_photograph_that_is_cut_short_is_marked(tmp_path: Path, part: float) -> None:
    """FFmpeg fills up with grey in silence."""
    noise = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    data = cv2.imencode(".jpg", noise)[1].tobytes()
    path, texts = tmp_path / "photograph.jpg", []
    path.write_bytes(data[: round(len(data) * part)])
    with Pipeline.parse(f"filesrc location={path} ! decode ! appsink name=out") as pipeline:
        pipeline.play()
        (frame,) = pipeline["out"]
        while (message := pipeline.bus.pop(0.0)) is not None:
            if message.fields.get("code") == "shortfall":
                texts.append(message.text)
    assert bool(frame.flags & FrameFlags.CORRUPT) == (part < 1.0)
    cut, damaged = f"{path}: the photograph is cut short, and part of it grey", "1 of 1 frames are damaged"
    assert texts == ([cut, damaged] if part < 1.0 else [])


def test_streams_of_other_lengths_are_no_cut(tmp_path: Path) -> None:
    """The video of a file whose sound goes on is whole."""
    for name in ("sound.mp4", "sound.mkv"):
        path = tmp_path / name
        with av.open(str(path), "w") as container:
            video, audio = container.add_stream("mpeg4", rate=25), container.add_stream("aac", rate=48000)
            video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
            for index in range(50):
                image = av.VideoFrame.from_ndarray(np.full((72, 64), 90, np.uint8), "yuv420p")
                image.pts, image.time_base = index, Fraction(1, 25)
                container.mux(video.encode(image))
            container.mux(video.encode(None))
            for index in range(6 * 48):
                sound = av.AudioFrame.from_ndarray(np.zeros((1, 1000), np.float32), "fltp", "mono")
                sound.sample_rate, sound.pts, sound.time_base = 48000, 1000 * index, Fraction(1, 48000)
                container.mux(audio.encode(sound))
            container.mux(audio.encode(None))
        messages: list[Message] = []
        pipeline = Pipeline.parse(f"filesrc location={path} ! fakesink")
        pipeline.bus.watch(messages.append)
        pipeline.run(timeout_s=20)
        assert pipeline["fakesink0"].count == 50
        assert not [message.text for message in messages if message.kind is MessageKind.WARNING]


def test_odd_media_ends_in_frames_or_one_error(streamkit_data: Path) -> None:
    """Every odd, truncated or fuzzed file gives frames or one clear error, in time and bounded memory."""
    files = [path for path in sorted((streamkit_data / "odd_media").rglob("*")) if path.is_file()]
    assert len(files) > 90
    outcomes: dict[str, int | str] = {}
    peak_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # of the tests before
    for path in files:
        began = time.monotonic()
        pipeline = Pipeline.parse(f'filesrc location="{path}" stop-s=1 ! decode ! fakesink name=out')
        try:
            pipeline.run(timeout_s=10)
            outcomes[path.name] = pipeline["out"].count
        except ElementFailure as error:
            outcomes[path.name] = str(error)
        assert time.monotonic() - began < 10, path
    errors = [outcome for outcome in outcomes.values() if isinstance(outcome, str)]
    assert 0 not in outcomes.values()
    assert len(outcomes) - len(errors) > 60
    assert all(error.startswith(("filesrc", "decode")) for error in errors)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak_kib < 3 * 2**18  # 768 MiB more


def test_each_stream_has_its_pad(streamkit_data: Path) -> None:
    """Video and KLV come out of their own pads, in the file's own times."""
    location = streamkit_data / "telemetry" / "sample-stream.ts"
    text = f"filesrc name=s location={location}  s.video ! appsink name=video max-buffers=0"
    with Pipeline.parse(f"{text}  s.klv ! appsink name=klv max-buffers=0") as pipeline:
        pipeline.play()
        video, klv = list(pipeline["video"]), list(pipeline["klv"])
    assert (len(video), len(klv)) == (277, 277)
    assert [frame.pts for frame in video] == [frame.pts for frame in klv]
    assert {frame.caps.name for frame in klv} == {"meta/x-klv"}


def test_a_pad_without_a_stream_in_the_file_is_reported(small_video: Path) -> None:
    """A link to telemetry that is not there warns, and the video plays on."""
    text = f"filesrc name=s location={small_video}  s.video ! appsink name=out  s.klv ! fakesink"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert len(list(pipeline["out"])) == 12
        warning = pipeline.bus.pop(5, (MessageKind.WARNING,))
    assert warning is not None
    assert "klv" in warning.text


@pytest.mark.parametrize(
    ("begin_s", "part", "count"),
    [(0, "", 12), (0, "start-s=.08 stop-s=.32", 6), (500, "", 12)],
    ids=["whole", "part", "recording that begins later"],
)
def test_times_ascend_over_loops(make_video: MakeVideo, begin_s: int, part: str, count: int) -> None:
    """With loop the video begins again at its end, and times ascend by the frame interval."""
    begin = {"output_ts_offset": str(begin_s)} if begin_s else None
    path = make_video(f"loop{begin_s}.mkv", container_options=begin)
    with Pipeline.parse(f"filesrc location={path} {part} loop=true ! decode ! appsink name=out") as pipeline:
        pipeline.play()
        frames = [pipeline["out"].pull(5) for _ in range(40)]
    first = frames[0].pts
    assert first // 10**9 == begin_s
    assert [frame.pts - first for frame in frames] == [n * 40_000_000 for n in range(40)]
    np.testing.assert_array_equal(frames[0].data, frames[count].data)


def test_a_variable_rate_keeps_its_times(tmp_path: Path) -> None:
    """Each frame of a video with irregular distances has its own time, to the millisecond of the file."""
    path, times = tmp_path / "variable.mkv", [0, 40, 50, 200, 210, 900, 1000, 5000]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        for time_ms in times:
            video_frame = av.VideoFrame.from_ndarray(np.full((72, 64), 100, np.uint8), "yuv420p")
            video_frame.pts, video_frame.time_base = time_ms, Fraction(1, 1000)
            container.mux(stream.encode(video_frame))
        container.mux(stream.encode(None))
    assert [frame.pts for frame in decoded(path)] == [time_ms * 1_000_000 for time_ms in times]


@pytest.mark.parametrize("name", ["h264_white_frame_sar_16_9.mp4", "matroska.mkv", "mjpeg.avi"])
def test_mutated_files_end_in_frames_or_one_error(streamkit_data: Path, tmp_path: Path, name: str) -> None:
    """40 mutations of a small file each end in time (benchmarks/fuzz_media.py makes thousands)."""
    (source,) = (streamkit_data / "odd_media").rglob(name)
    data, path = source.read_bytes(), tmp_path / name
    for number in range(40):
        chance, variant = random.Random(number), bytearray(data)
        for _ in range(chance.choice((1, 4, 30))):
            variant[chance.randrange(len(variant))] = chance.randrange(256)
        path.write_bytes(variant)
        pipeline = Pipeline.parse(f"filesrc location={path} ! decode ! fakesink name=out")
        outcome = ""
        try:
            pipeline.run(timeout_s=10)
        except ElementFailure as error:
            outcome = error.element
        assert outcome in ("filesrc0", "decode0") or pipeline["out"].count > 0


def test_a_second_telemetry_stream_has_its_own_pad(two_klv_streams: Path) -> None:
    """The pads klv and klv_1 give the packets of the two streams, and the second alone pairs all frames."""
    text = f"filesrc name=s location={two_klv_streams}  s.klv ! appsink name=a  s.klv_1 ! appsink name=b"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        sizes = [{len(bytes(frame.data)) for frame in pipeline[name]} for name in ("a", "b")]
    assert sizes == [{31}, {43}]
    text = f"filesrc name=s location={two_klv_streams} ! decode ! posesync name=p ! appsink name=out"
    with Pipeline.parse(f"{text}  s.klv_1 ! p.telemetry") as pipeline:
        pipeline.play()
        poses = [frame.get(Pose) for frame in pipeline["out"]]
    assert [round(pose.latitude, 3) if pose else None for pose in poses] == [10.0 + n for n in range(12)]


def test_a_second_telemetry_stream_that_nothing_reads_is_reported(two_klv_streams: Path) -> None:
    """A warning names the second stream where only the first is linked."""
    with Pipeline.parse(f"filesrc name=s location={two_klv_streams}  s.klv ! fakesink") as pipeline:
        pipeline.play()
        warning = pipeline.bus.pop(5, (MessageKind.WARNING,))
    assert warning is not None
    assert warning.text == f"{two_klv_streams}: nothing reads its second KLV stream, the pad klv_1"


@pytest.mark.parametrize("head", [b"", b"rubbish before the first key"])
def test_bare_klv_packets(tmp_path: Path, klv_packet: Callable[..., bytes], head: bytes) -> None:
    """A file of packets without a container is read; their times are by the platform's clock."""
    path = tmp_path / "s.klv"
    path.write_bytes(head + b"".join(klv_packet(10.0 + n, 10**15 + 500_000 * n) for n in range(5)))
    with Pipeline.parse(f"filesrc location={path} ! telemetryparse ! appsink name=out") as pipeline:
        pipeline.play()
        rows = [json.loads(frame.data) for frame in pipeline["out"]]
    assert [row["pts_ns"] for row in rows] == [n * 500_000_000 for n in range(5)]
    assert [round(row["latitude"], 3) for row in rows] == [10.0 + n for n in range(5)]


def test_bare_klv_packets_cannot_be_decoded(tmp_path: Path, klv_packet: Callable[..., bytes]) -> None:
    """Decoding such a file fails with the reason."""
    path = tmp_path / "s.klv"
    path.write_bytes(klv_packet(10.0))
    with pytest.raises(ElementFailure, match="a video stream is needed, its streams are: data"):
        Pipeline.parse(f"filesrc location={path} ! decode ! fakesink").run(timeout_s=5)


def test_a_file_of_subtitles_goes_to_a_reader_of_them(streamkit_data: Path) -> None:
    """No video is asked for where nothing takes one."""
    location = streamkit_data / "telemetry" / "dji" / "air2s.srt"
    with Pipeline.parse(f"filesrc location={location} ! telemetryparse ! appsink name=out") as pipeline:
        pipeline.play()
        assert json.loads(next(iter(pipeline["out"])).data)["latitude"] == 41.424724


@pytest.mark.parametrize(
    ("location", "remedy"),
    [
        ("udp://@:5000", "write livesrc uri=udp://@:5000"),
        ("rtmp://me:secret@drone/live", "write livesrc uri=rtmp://***@drone/live"),
        ("rtsp://me:secret@drone/live", "write rtspsrc location=rtsp://***@drone/live"),
    ],
)
def test_live_video_is_left_to_its_sources(location: str, remedy: str) -> None:
    """A stream that nobody can rewind is no file; the error names the element for it."""
    pipeline = Pipeline.parse(f"filesrc location={location} ! fakesink")
    with pytest.raises(ElementFailure, match=re.escape(remedy)):
        pipeline.ready()
    pipeline.stop()


def test_a_connection_that_is_being_opened_can_be_cancelled() -> None:
    """A silent server does not hold up the stop, and no thread stays."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        pipeline = Pipeline.parse(f"filesrc location=http://127.0.0.1:{port} ! fakesink")
        failures: list[Exception] = []

        def play() -> None:
            try:
                pipeline.play()
            except ElementFailure as failure:
                failures.append(failure)

        starting = threading.Thread(target=play)
        starting.start()
        connection, _ = server.accept()
        began = time.monotonic()
        pipeline.cancel()
        starting.join(10)
        assert time.monotonic() - began < patience(2)
        assert "its start was interrupted" in str(failures[0])
        assert not [thread for thread in threading.enumerate() if "filesrc" in thread.name]
        connection.close()


@pytest.mark.parametrize("source", ["filesrc location=any.mp4", "videotestsrc num-buffers=9", "dronetestsrc"])
def test_the_length_is_unknown_before_the_start(source: str) -> None:
    """The progress line asks for it also where an interrupt has ended a start."""
    assert Pipeline.parse(f"{source} ! fakesink").duration_ns() is None


def _times(location: Path, pad: str) -> tuple[list[int], list[str]]:
    """The times of one pad's packets, ms, sorted as they are shown; and the warnings of the run."""
    warnings: list[str] = []
    with Pipeline.parse(f'filesrc name=s location="{location}"  s.{pad} ! appsink name=out') as pipeline:
        pipeline.bus.watch(
            lambda message: message.kind is MessageKind.WARNING and warnings.append(message.text)
        )
        pipeline.play()
        times = sorted(round((frame.pts or 0) / 1e6) for frame in pipeline["out"])
    return times, warnings


@pytest.mark.parametrize("first_s", [1, 100], ids=["back to the beginning", "back by more than a minute"])
def test_times_go_on_where_recordings_are_joined(make_video: MakeVideo, tmp_path: Path, first_s: int) -> None:
    """Two transport streams, one behind the other: FFmpeg takes a long step back for a wrap of 26.5 hours."""
    parts = [
        make_video(f"part{first_s}-{begin}.ts", container_options={"output_ts_offset": str(begin)})
        for begin in (first_s, 1)
    ]
    joined = tmp_path / "joined.ts"
    joined.write_bytes(b"".join(part.read_bytes() for part in parts))
    times, warnings = _times(joined, "video")
    assert len(times) == 24
    assert {after - before for before, after in itertools.pairwise(times)} == {40}
    assert "its times go back at " in warnings[0]
    assert _times(parts[0], "video")[1] == []


def test_another_codec_in_joined_recordings_is_named(make_video: MakeVideo, tmp_path: Path) -> None:
    """FFmpeg goes on with the first: what follows is lost, and the reasons that decode gives are no help."""
    # FFmpeg looks far enough into a short one to take all for the second.
    parts = [make_video("first.ts", count=100), make_video("second.ts", codec="mpeg2video")]
    joined = tmp_path / "joined.ts"
    joined.write_bytes(b"".join(part.read_bytes() for part in parts))
    _, warnings = _times(joined, "video")
    assert "its times go back" in warnings[0]
    assert "its video is video/mpeg from" in warnings[1]
    assert "read as video/x-h264; read the recordings one by one" in warnings[1]


def test_an_mp4_file_appended_to_another_is_named(make_video: MakeVideo, tmp_path: Path) -> None:
    """FFmpeg reads the first alone, and says nothing."""
    joined = tmp_path / "joined.mp4"
    joined.write_bytes(2 * make_video("alone.mp4").read_bytes())
    times, warnings = _times(joined, "video")
    assert len(times) == 12
    assert ["another recording is appended to it, and is not read" in text for text in warnings] == [True]


def test_the_end_of_a_part_may_lie_in_the_second_of_joined_recordings(
    make_video: MakeVideo, tmp_path: Path
) -> None:
    """stop-s counts in the times that the frames have: 15 of 24 come before 0.6 s."""
    joined = tmp_path / "joined.ts"
    joined.write_bytes(2 * make_video("part.ts").read_bytes())
    assert len(decoded(joined, "stop-s=0.6")) == 15


def test_telemetry_of_joined_recordings_stays_with_its_video(clip: Path, tmp_path: Path) -> None:
    """Its times move with those of the video that it was recorded with."""
    joined = tmp_path / "joined.ts"
    joined.write_bytes(3 * clip.read_bytes())
    video, telemetry = (_times(joined, pad)[0] for pad in ("video", "klv"))
    assert len(video) == 300
    assert sum(time not in video for time in telemetry) <= 2  # the first of a part comes before its picture


def test_a_server_that_serves_no_parts_is_not_taken_for_a_damaged_file(
    make_video: Callable[..., Path], tmp_path: Path, serve_folder: str
) -> None:
    """As Python's own: an index at the end of the file leads back to its beginning."""
    video = make_video("large.mov", 40, (320, 240), codec="mjpeg", pixel_format="yuvj420p")
    shutil.copy(video, tmp_path)
    with pytest.raises(ElementFailure, match=r"reading failed: .*; the server may not serve parts of a file"):
        Pipeline.parse(f"filesrc location={serve_folder}/large.mov ! fakesink").run(timeout_s=30)
