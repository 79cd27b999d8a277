"""Tests of files that store the times of decoding as those of presentation."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import av
import pytest

from streamkit import Message, Pipeline
from streamkit_media.doctor.examine import examine

MakeVideo = Callable[..., Path]
OPTIONS = {"g": "20", "b_strategy": "0"}


def _in_order_of_coding(path: Path, suffix: str = ".mp4") -> Path:
    """A copy as of a writer that stores no composition offsets."""
    copy = path.with_name(f"{path.stem}-coding{suffix}")
    with av.open(str(path)) as source, av.open(str(copy), "w") as container:
        stream = container.add_stream_from_template(source.streams.video[0])
        first: int | None = None
        for packet in source.demux(video=0):
            if packet.dts is None:
                continue
            first = packet.dts if first is None else first
            packet.dts -= first
            packet.pts, packet.stream = packet.dts, stream
            container.mux(packet)
    return copy


def _times(path: Path, rest: str = "") -> tuple[list[int | None], list[str]]:
    """The times of what comes out, ns, and the warnings."""
    messages: list[Message] = []
    with Pipeline.parse(f"filesrc location={path} ! {rest} appsink name=out max-buffers=0") as pipeline:
        pipeline.bus.watch(messages.append)
        pipeline.play()
        times = [frame.pts for frame in pipeline["out"]]
    return times, [message.text for message in messages if message.kind == "warning"]


@pytest.mark.parametrize("codec", ["libx264", "libx265"])
@pytest.mark.parametrize("count", [9, 100])
@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_packets_get_the_times_of_presentation(
    make_video: MakeVideo, codec: str, count: int, suffix: str
) -> None:
    """Those that a writer with composition offsets stores; frames take the same, and one warning says so."""
    extra = {"x265-params": "log-level=0:bframes=3:keyint=20"} if codec == "libx265" else {}
    name = f"{codec}{count}.mp4"
    right = make_video(name, count=count, codec=codec, bframes=3, options=OPTIONS | extra)
    wrong = _in_order_of_coding(right, suffix)
    expected, warnings = _times(right)
    assert not warnings
    assert expected != sorted(expected)  # it has B-frames
    times, warnings = _times(wrong)
    assert times == expected
    assert ["order of coding" in text for text in warnings] == [True]
    assert _times(wrong, "decode ! ") == (sorted(expected), warnings)


def test_a_recording_of_such_a_file_has_right_times(make_video: MakeVideo, tmp_path: Path) -> None:
    """No packet is decoded after it is shown, and the times of decoding ascend."""
    right = make_video("record.mp4", count=60, bframes=3, options=OPTIONS)
    copy = tmp_path / "copy.mp4"
    Pipeline.parse(f"filesrc location={_in_order_of_coding(right)} ! packetsink location={copy}").run(20)
    assert _times(copy) == _times(right)
    with av.open(str(copy)) as container:
        packets = [packet for packet in container.demux(video=0) if packet.dts is not None]
    steps = [b.dts - a.dts for a, b in pairwise(packets)]
    assert min(steps[4:]) == max(steps[4:]) > 0


def test_a_part_of_such_a_file_is_played(make_video: MakeVideo) -> None:
    """From a time inside; what was mended before the part does not matter."""
    right = make_video("part.mp4", count=60, bframes=3, options=OPTIONS)
    times, _ = _times(_in_order_of_coding(right), "decode ! ")
    wrong = _in_order_of_coding(right)
    with Pipeline.parse(f"filesrc location={wrong} start-s=1 ! decode ! appsink name=out") as pipeline:
        pipeline.play()
        part = [frame.pts for frame in pipeline["out"]]
    assert part == times[-len(part) :]
    assert part[0] == 1_000_000_000


def test_doctor_notes_the_times(make_video: MakeVideo) -> None:
    """It says what the file has, though the packets that come out of it are right."""
    wrong = _in_order_of_coding(make_video("doctor.mp4", count=40, bframes=3, options=OPTIONS))
    assert "times" in [check.name for check in examine(str(wrong), 1.0, 10.0, "auto").checks]
