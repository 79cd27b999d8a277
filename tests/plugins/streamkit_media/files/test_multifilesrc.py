from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from streamkit import ElementFailure, Frame, FrameFlags, Message, MessageKind, Pipeline


@pytest.fixture
def numbered(tmp_path: Path) -> Path:
    """im001.png to im005.png, each of its own grey."""
    for number in range(1, 6):
        cv2.imwrite(str(tmp_path / f"im{number:03d}.png"), np.full((48, 64), 20 * number, np.uint8))
    return tmp_path


def decoded(text: str, limit: int = 100) -> list[Frame]:
    """The first frames of a source, decoded."""
    with Pipeline.parse(f"multifilesrc {text} ! decode ! appsink name=out") as pipeline:
        pipeline.play()
        frames = []
        for frame in pipeline["out"]:
            frames.append(frame)
            if len(frames) == limit:
                break
        return frames


def warnings(text: str) -> list[tuple[str, object]]:
    """Texts and codes of the warnings of a whole run."""
    messages: list[Message] = []
    with Pipeline.parse(f"multifilesrc {text} ! decode ! fakesink") as pipeline:
        pipeline.bus.watch(messages.append)
        pipeline.run()
    return [(one.text, one.fields.get("code")) for one in messages if one.kind is MessageKind.WARNING]


def greys(frames: list[Frame]) -> list[int]:
    """The grey of each frame over 20: its file's number."""
    return [int(frame.data[0, 0]) // 20 for frame in frames]


def test_files_are_read_up_to_the_first_missing(numbered: Path) -> None:
    """The video ends at the first number without a file."""
    frames = decoded(f"location={numbered}/im%03d.png start-index=1 framerate=30000/1001")
    assert greys(frames) == [1, 2, 3, 4, 5]
    assert [frame.pts for frame in frames] == [round(n * 10**9 * Fraction(1001, 30000)) for n in range(5)]
    assert frames[0].caps["framerate"] == Fraction(30000, 1001)


def test_start_and_stop_index(numbered: Path) -> None:
    """start-index and stop-index are both shown."""
    assert greys(decoded(f"location={numbered}/im%03d.png start-index=2 stop-index=4")) == [2, 3, 4]


@pytest.mark.parametrize(
    ("stop", "rest"),
    [
        ("", "2 files that come after it are not read; go on with start-index=4"),
        (
            "stop-index=4",
            "1 files that come after it up to stop-index=4 are not read; go on with start-index=4",
        ),
        ("stop-index=3", "no file follows up to stop-index=3"),
    ],
)
def test_a_gap_is_a_shortfall(numbered: Path, stop: str, rest: str) -> None:
    """The video ends at the first missing number, as GStreamer's does, and says what it leaves out."""
    (numbered / "im003.png").unlink()
    text = f"location={numbered}/im%03d.png start-index=1 {stop}"
    assert greys(decoded(text)) == [1, 2]
    expected = f"{numbered}/im003.png is missing, the video ends before it: {rest}"
    assert warnings(text) == [(expected, "shortfall")]


def test_an_end_without_a_gap_is_no_shortfall(numbered: Path) -> None:
    """A file after stop-index, or of another name, is none that is left out."""
    cv2.imwrite(str(numbered / "im7.png"), np.zeros((48, 64), np.uint8))
    assert not warnings(f"location={numbered}/im%03d.png start-index=1")
    (numbered / "im003.png").unlink()
    assert not warnings(f"location={numbered}/im%03d.png start-index=1 stop-index=2")


def test_a_first_number_that_is_missing_names_the_one_there_is(numbered: Path) -> None:
    """Few cameras count from 0."""
    with pytest.raises(ElementFailure, match=r"im000.png is not there; the files begin with start-index=1$"):
        decoded(f"location={numbered}/im%03d.png")


def test_loop_begins_again(numbered: Path) -> None:
    """With loop the first frame follows the last, and times ascend."""
    frames = decoded(f"location={numbered}/im%03d.png start-index=4 loop=true framerate=10/1", limit=5)
    assert greys(frames) == [4, 5, 4, 5, 4]
    assert [frame.pts for frame in frames] == [n * 100_000_000 for n in range(5)]


def test_frames_of_another_size_change_caps(numbered: Path) -> None:
    """A frame of another size in the row comes out in its own size."""
    cv2.imwrite(str(numbered / "im006.png"), np.full((24, 32), 120, np.uint8))
    frames = decoded(f"location={numbered}/im%03d.png start-index=5")
    assert [frame.data.shape for frame in frames] == [(48, 64), (24, 32)]
    assert [frame.caps["width"] for frame in frames] == [64, 32]


def test_a_photograph_that_is_cut_short_is_marked(tmp_path: Path) -> None:
    """FFmpeg fills up with grey in silence; the end marker of a thumbnail is not that of the picture."""
    noise = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    whole = cv2.imencode(".jpg", noise)[1].tobytes()
    whole = whole[:2] + b"\xff\xe1\x00\x06\xff\xd9\xff\xd9" + whole[2:]
    for number, size in enumerate((len(whole), len(whole) // 2, len(whole))):
        (tmp_path / f"{number}.jpg").write_bytes(whole[:size])
    frames = decoded(f"location={tmp_path}/%d.jpg")
    assert [bool(frame.flags & FrameFlags.CORRUPT) for frame in frames] == [False, True, False]
    assert [text for text, _ in warnings(f"location={tmp_path}/%d.jpg")] == [
        f"{tmp_path}/1.jpg is cut short, and part of its picture grey",
        "1 of 3 frames are damaged",
    ]


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("location=im%03d.png", r"im000\.png: a file must be there, none is"),
        (
            "location=im.png",
            r"location='im\.png' must hold one number; write location=img/%06d\.jpg",
        ),
        ("location=im%d_%d.png", "must hold one number"),
        ("location=im%s.png", "must hold one number"),
        ("location=im%03d.png start-index=3 stop-index=2", "stop-index=2 must not be below start-index=3"),
    ],
)
def test_bad_locations_fail_before_playing(text: str, rule: str) -> None:
    """A missing first file and a wrong pattern are known when the element starts."""
    pipeline = Pipeline.parse(f"multifilesrc {text} ! decode ! fakesink")
    with pytest.raises(ElementFailure, match=rule):
        pipeline.ready()
    pipeline.stop()


def test_real_frames(streamkit_data: Path) -> None:
    """A tracking sequence of JPEG files plays."""
    frames = decoded(f"location={streamkit_data}/sot/car4/img/%06d.jpg start-index=1 stop-index=10")
    assert [frame.seq for frame in frames] == list(range(10))
    first = cv2.imread(str(streamkit_data / "sot" / "car4" / "img" / "000001.jpg"), cv2.IMREAD_GRAYSCALE)
    assert first is not None
    assert np.abs(frames[0].data.astype(int) - first).max() <= 2


def test_a_name_that_is_too_long_is_explained(tmp_path: Path) -> None:
    """By the path, the reason and what to check, as for filesrc."""
    with pytest.raises(ElementFailure, match="the file cannot be read: File name too long; check the path"):
        decoded(f"location={tmp_path}/{'d' * 300}%d.png")
