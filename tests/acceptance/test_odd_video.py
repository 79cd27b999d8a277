"""The ready pipelines take video of any size."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

import streamkit
from tests.command_line import run

OVERLAY = Path(__file__).parents[2] / "pipelines" / "file-to-overlay.pipe"
ORANGE = (255, 128, 0)


def write_orange(path: Path, width: int, height: int) -> None:
    """Writes three frames of one colour as PNG in QuickTime, which takes every size."""
    with av.open(path, "w") as container:
        stream = container.add_stream("png", rate=Fraction(25), width=width, height=height, pix_fmt="rgb24")
        image = np.full((height, width, 3), ORANGE, np.uint8)
        for _ in range(3):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, "rgb24")))
        container.mux(stream.encode())


def overlay_of(folder: Path, width: int, height: int) -> NDArray[np.uint8]:
    """The first frame of the overlay that the ready pipeline makes of a video of one colour."""
    write_orange(folder / "in.mov", width, height)
    names = {"input": "in.mov", "output": "out.jsonl", "overlay": "out.mp4"}
    settings = [word for name, file in names.items() for word in ("--set", f"{name}={folder / file}")]
    done = run("launch", "-q", "-f", OVERLAY, *settings)
    assert done.returncode == 0, done.stderr
    with streamkit.open(folder / "out.mp4") as video:
        frames = [frame.data for frame in video]
    assert len(frames) == 3
    return frames[0]


def test_an_overlay_of_even_size_has_colours(tmp_path: Path) -> None:
    """The pipeline takes frames with their colours, although tracks need none."""
    blue, _, red = overlay_of(tmp_path, 160, 96)[-10, -10].astype(int)
    assert red - blue > 200


def test_a_video_of_odd_size_has_an_overlay(tmp_path: Path) -> None:
    """The overlay is grey, as colours do not pass stitch, and H.264 adds a row and a column."""
    image = overlay_of(tmp_path, 161, 97)
    assert image.shape == (98, 162, 3)
    assert np.ptp(image[-10, -10].astype(int)) < 5
