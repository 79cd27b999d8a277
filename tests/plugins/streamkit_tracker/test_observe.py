"""What the tracker is given of a frame."""

import numpy as np
import pytest

from streamkit import Frame, raw_video_caps
from streamkit_tracker.element import observe


def frame(pixel_format: str, data: np.ndarray) -> Frame:
    """A frame of 6 x 4 px."""
    return Frame(data, raw_video_caps(pixel_format, 6, 4), pts=0, seq=0)


@pytest.mark.parametrize("pixel_format", ["I420", "NV12"])
def test_chroma_planes_reach_the_tracker(pixel_format: str):
    """Both layouts give the same two planes, as views."""
    u, v = np.arange(6, dtype=np.uint8).reshape(2, 3), np.arange(10, 16, dtype=np.uint8).reshape(2, 3)
    both = np.stack([u, v]).reshape(2, 6) if pixel_format == "I420" else np.dstack([u, v]).reshape(2, 6)
    data = np.concatenate([np.zeros((4, 6), np.uint8), both])
    chroma = observe(frame(pixel_format, data), None).chroma
    assert chroma is not None
    np.testing.assert_array_equal(chroma[0], u)
    np.testing.assert_array_equal(chroma[1], v)
    assert all(np.shares_memory(plane, data) for plane in chroma)


def test_a_grey_frame_has_no_chroma():
    """GRAY8 has a luma plane only."""
    assert observe(frame("GRAY8", np.zeros((4, 6), np.uint8)), None).chroma is None
