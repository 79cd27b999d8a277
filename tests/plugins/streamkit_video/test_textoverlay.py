"""Tests of textoverlay, timeoverlay and clockoverlay."""

import re

import numpy as np
import pytest

from streamkit import Capture, Frame, raw_video_caps
from streamkit.testing import Harness
from streamkit_video.textoverlay import ClockOverlay, TimeOverlay, font_size
from tests.frames import frames_of

WIDTH, HEIGHT = 320, 240


def grey(level: int = 100, pts: int = 0) -> Frame:
    """A frame of one level."""
    return Frame(np.full((HEIGHT, WIDTH), level, np.uint8), raw_video_caps("GRAY8", WIDTH, HEIGHT), pts=pts)


def drawn(frame: Frame, **properties: object) -> np.ndarray:
    """Which pixels of a frame a textoverlay changes."""
    with Harness("textoverlay", **properties) as harness:
        (out,) = harness.push(frame)
    return out.data != frame.data


def box(mask: np.ndarray) -> tuple[int, int, int, int]:
    """The first and last column and row that are set."""
    (rows, columns) = np.nonzero(mask)
    return columns.min(), columns.max(), rows.min(), rows.max()


@pytest.mark.parametrize("horizontal", ["left", "center", "right"])
@pytest.mark.parametrize("vertical", ["top", "center", "bottom", "baseline"])
def test_the_text_stands_where_it_is_asked_for(horizontal: str, vertical: str) -> None:
    """Within a few pixels of the border that the padding gives."""
    left, right, top, bottom = box(
        drawn(grey(), text="HHHH", halignment=horizontal, valignment=vertical, xpad=10, ypad=20)
    )
    where = {
        "left": abs(left - 10),
        "right": abs(WIDTH - 10 - right),
        "center": abs(left + right - WIDTH) / 2,
    }
    assert where[horizontal] <= 4
    rows = {
        "top": abs(top - 20), "bottom": abs(HEIGHT - 20 - bottom) - 4, "baseline": abs(HEIGHT - 20 - bottom),
        "center": abs(top + bottom - HEIGHT) / 2,
    }  # fmt: skip
    assert rows[vertical] <= 5


def test_it_can_be_read_on_white_and_on_black() -> None:
    """White letters have a dark edge."""
    for level in (0, 255):
        with Harness("textoverlay", text="flight 7") as harness:
            (out,) = harness.push(grey(level))
        assert {0, 255} <= set(np.unique(out.data))


def test_the_size_follows_the_description_of_the_font() -> None:
    """Twice the number is twice the height; without a number there is a default."""
    heights = []
    for font in ("Sans, 16", "Sans Bold 32px"):
        _, _, top, bottom = box(drawn(grey(), text="H", font_desc=font))
        heights.append(bottom - top)
    assert heights[1] == pytest.approx(2 * heights[0], rel=0.2)
    assert [font_size(text) for text in ("", "Sans", "Sans 9999", "12", "Mono, 1")] == [18, 18, 400, 12, 4]


def test_lines_stand_below_each_other_and_are_bounded() -> None:
    """A text may have several lines; what does not fit is cut off."""
    one, two = (box(drawn(grey(), text=text, valignment="top")) for text in ("H", "H\nH"))
    assert two[2] == one[2]
    assert two[3] > one[3] + 15
    assert drawn(grey(), text="x" * 100_000 + "\n" * 100_000 + "x", valignment="top").any()


def test_the_background_can_be_shaded() -> None:
    """The video behind the text becomes darker."""
    with Harness("textoverlay", text="flight", shaded_background=True) as harness:
        (out,) = harness.push(grey())
    assert (out.data == 40).sum() > 500


def test_frames_without_text_pass_untouched() -> None:
    """The very array comes out."""
    frame = grey()
    with Harness("textoverlay") as harness:
        (out,) = harness.push(frame)
    assert out.data is frame.data


@pytest.mark.parametrize("name", ["BGR", "RGBA", "GRAY8"])
def test_other_formats_are_drawn_on_alike(name: str) -> None:
    """A pipeline of one line; other formats get a videoconvert."""
    lines = f"videotestsrc num-buffers=1 pattern=black ! video/x-raw, format={name} ! "
    (frame,) = frames_of(f"{lines} textoverlay text=flight")
    assert frame.data.max() == 255
    (frame,) = frames_of("videotestsrc num-buffers=1 ! video/x-raw, format=I420 ! timeoverlay")
    assert frame.caps["format"] != "I420"


@pytest.mark.parametrize(
    ("pts", "text"), [(0, "0:00:00.000"), (3_723_004_999_999, "1:02:03.004"), (None, "")]
)
def test_the_time_is_that_of_the_frame(pts: int | None, text: str) -> None:
    """Hours, minutes, seconds and milliseconds, rounded down; a frame without a time has none."""
    frame = grey().replace(pts=pts)
    assert TimeOverlay().written(frame) == text
    assert TimeOverlay(text="at").written(frame) == f"at {text}".strip()


def test_the_clock_is_that_of_the_capture() -> None:
    """In UTC; where the capture is unknown it is the present."""
    frame = grey().replace(capture=Capture(1_700_000_000_500_000_000, "file"))
    assert ClockOverlay().written(frame) == "22:13:20"
    assert ClockOverlay(time_format="%Y-%m-%d").written(frame) == "2023-11-14"
    assert re.fullmatch(r"\d\d:\d\d:\d\d", ClockOverlay().written(grey()))
