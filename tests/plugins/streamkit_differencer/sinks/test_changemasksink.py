"""Masks in files."""

import cv2
import numpy as np
import pytest

from streamkit import ElementFailure, Frame, Pipeline, PropertyError, ResourceError, raw_video_caps
from streamkit.testing import Harness


def test_files_are_named_and_valued_as_the_tools_read_them(tmp_path):
    """Six digits from 1; 255 for what moves and what has stopped, 0 for shadow and ground."""
    folder = tmp_path / "results" / "baseline"
    with Harness("changemasksink", location=str(folder)) as harness:
        for value in (255, 50):
            mask = np.zeros((4, 6), np.uint8)
            mask[1, 2] = value
            mask[2, 3] = 128 if value == 255 else 0
            harness.push(Frame(mask, raw_video_caps("GRAY8", 6, 4)))
    assert sorted(path.name for path in folder.iterdir()) == ["bin000001.png", "bin000002.png"]
    first, second = (cv2.imread(str(folder / f"bin00000{n}.png"), cv2.IMREAD_UNCHANGED) for n in (1, 2))
    assert first.shape == (4, 6)
    assert first[1, 2] == 255
    assert first[2, 3] == 255
    assert first.sum() == 2 * 255
    assert not second.any()


def test_the_mask_pad_gives_a_mask_for_every_frame(tmp_path):
    """From the pad through the sink, at the frames' size, also while nothing is known yet."""
    Pipeline.parse(
        "videotestsrc num-buffers=5 ! video/x-raw, width=161, height=121 ! framediff working-scale=2 name=d"
        f" ! fakesink  d.mask ! queue ! changemasksink location={tmp_path} first-number=10"
    ).run(timeout_s=30)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"bin{number:06d}.png" for number in range(10, 15)]
    assert cv2.imread(str(tmp_path / names[0]), cv2.IMREAD_UNCHANGED).shape == (121, 161)


@pytest.mark.parametrize("before", ["", "framediff motion=none !"])
def test_a_video_is_no_mask(tmp_path, before):
    """Thresholded, it would pass for masks; the error names the pad."""
    with pytest.raises(ElementFailure, match=r"link the pad mask: framediff name=d d\.mask ! changemasksink"):
        Pipeline.parse(f"videotestsrc num-buffers=5 ! {before} changemasksink location={tmp_path / 'm'}").run(
            timeout_s=30
        )
    assert not list(tmp_path.rglob("*.png"))


def test_the_name_of_a_file_is_refused():
    """It would become a folder."""
    with pytest.raises(PropertyError, match="names a folder, in which the masks are in%06d"):
        Harness("changemasksink", location="masks/%06d.png", prefix="in")


def test_a_folder_that_cannot_be_made(tmp_path):
    """The error names it, and the remedy."""
    (tmp_path / "file").write_text("")
    with pytest.raises(ResourceError, match=r"cannot be written: Not a directory"):
        Harness("changemasksink", location=str(tmp_path / "file" / "masks"))
    with pytest.raises(ResourceError, match="location must be set"):
        Harness("changemasksink")
