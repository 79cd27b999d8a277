"""Pictures of the canvas on another canvas, and the last frames on it."""

import numpy as np
import pytest

from streamkit_differencer.anchor import translation
from streamkit_differencer.resampling import LastFrames, scrolled, warped

SHAPE = (120, 160)


@pytest.mark.parametrize(("dx", "dy"), [(5, -3), (-7, 4), (0, 0), (100, 0), (0, -60)])
def test_scrolling_moves_pixels_and_loses_nothing_else(dx, dy):
    """What was at (x, y) is at (x + dx, y + dy); what comes in is filled."""
    image = np.random.default_rng(0).integers(1, 255, SHAPE).astype(np.uint8)
    moved = scrolled(image, dx, dy, 0)
    for y, x in np.ndindex(SHAPE):
        inside = 0 <= y - dy < SHAPE[0] and 0 <= x - dx < SHAPE[1]
        assert moved[y, x] == (image[y - dy, x - dx] if inside else 0)


def test_warping_by_whole_pixels_is_scrolling():
    """With nearest neighbours and with cubic interpolation, and what comes in is filled."""
    image = np.random.default_rng(1).integers(1, 255, SHAPE).astype(np.float32)
    np.testing.assert_array_equal(warped(image, translation(4, -9), 7), scrolled(image, 4, -9, 7))


def test_the_last_frames_are_kept_and_no_more():
    """The newest is last; memory does not grow with the frames."""
    frames = LastFrames((4, 6), 3)
    region = np.s_[1:3, 2:5]
    for number in range(1, 8):
        picture, seen = np.full((2, 3), number, np.uint8), np.full((2, 3), 255, np.uint8)
        frames.append(frames.place(picture, seen, region))
        assert len(frames) == min(number, 3)
    assert [int(frames[index].image[1, 2]) for index in range(3)] == [5, 6, 7]
    assert frames[-1].seen.sum() == 6 * 255
    frames.scroll(1, 0)
    assert int(frames[-1].image[1, 5]) == 7
    assert not frames[-1].seen[:, :3].any()


def test_a_frame_drawn_in_its_room_need_not_be_copied():
    """What was drawn there is the newest frame; a frame from elsewhere is copied over what was drawn."""
    frames, region = LastFrames((4, 6), 2), np.s_[1:3, 2:5]
    for number in range(1, 6):
        room = frames.room()
        assert not room.seen.any()
        room.image[region], room.seen[region] = number, 255
        placed = frames.place(room.image[region], room.seen[region], region)
        assert placed is room
        frames.append(placed)
    assert [int(frame.image[1, 2]) for frame in (frames[0], frames[1])] == [4, 5]
    frames.room().image[:] = 77
    elsewhere = np.full((4, 6), 6, np.uint8), np.full((4, 6), 255, np.uint8), np.s_[:4, :6]
    frames.append(frames.place(*elsewhere))
    assert [int(frame.image[1, 2]) for frame in (frames[0], frames[1])] == [5, 6]
    assert frames[1].seen.all()
