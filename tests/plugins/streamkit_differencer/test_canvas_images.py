"""Images of the canvas on another canvas, and the last frames on it."""

import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_differencer.canvas_images import FrameHistory, scrolled, warped

SHAPE = (120, 160)


@pytest.mark.parametrize(("dx", "dy"), [(5, -3), (-7, 4), (0, 0), (100, 0), (0, -60)])
def test_scrolling_moves_pixels_and_loses_nothing_else(dx, dy):
    """What was at (x, y) is at (x + dx, y + dy); what comes in is filled."""
    image = np.random.default_rng(0).integers(1, 255, SHAPE).astype(np.uint8)
    moved = scrolled(image, dx, dy, 0)
    for y, x in np.ndindex(SHAPE):
        inside = 0 <= y - dy < SHAPE[0] and 0 <= x - dx < SHAPE[1]
        assert moved[y, x] == (image[y - dy, x - dx] if inside else 0)


@pytest.mark.parametrize("seed", range(3))
def test_scrolling_again_and_again_moves_pixels_and_loses_nothing_else(seed):
    """What leaves does not come back, wherever in its memory the image begins."""
    random = np.random.default_rng(seed)
    image = random.uniform(1, 255, SHAPE).astype((np.uint8, np.float32, np.uint8)[seed])
    moved, expected = image.copy(), image.copy()
    for dx, dy in [*random.integers(-25, 26, (60, 2)).tolist(), (0, 0), (0, -300), (200, 1)]:
        moved = scrolled(moved, dx, dy, 7)
        wide = np.full((SHAPE[0] + 600, SHAPE[1] + 600), 7, image.dtype)
        wide[300 + dy : 300 + dy + SHAPE[0], 300 + dx : 300 + dx + SHAPE[1]] = expected
        expected = wide[300 : 300 + SHAPE[0], 300 : 300 + SHAPE[1]].copy()
        assert moved.flags.c_contiguous
        np.testing.assert_array_equal(moved, expected)
        moved[3, 4] = expected[3, 4] = 99


def test_warping_by_whole_pixels_is_scrolling():
    """With nearest neighbours and with cubic interpolation, and what comes in is filled."""
    image = np.random.default_rng(1).integers(1, 255, SHAPE).astype(np.float32)
    np.testing.assert_array_equal(warped(image, translation((4, -9)), 7), scrolled(image, 4, -9, 7))


def test_the_last_frames_are_kept_and_no_more():
    """The newest is last; memory does not grow with the frames."""
    frames = FrameHistory((4, 6), 3)
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


def test_a_frame_drawn_in_a_room_that_was_scrolled_stays_as_it_is():
    """The room is that of a frame that may have been moved within its memory."""
    frames, region = FrameHistory((4, 6), 1), np.s_[1:3, 2:5]
    for number in range(1, 5):
        room = frames.next_frame()
        room.image[region], room.seen[region] = number, 255
        frames.append(frames.place(room.image[region], room.seen[region], region))
        frames.scroll(1, 0)
        assert frames[0].image.tolist()[1][3:] == [number] * 3
        assert frames[0].seen.sum() == 6 * 255


def test_a_frame_drawn_in_its_room_need_not_be_copied():
    """What was drawn there is the newest frame; a frame from elsewhere is copied over what was drawn."""
    frames, region = FrameHistory((4, 6), 2), np.s_[1:3, 2:5]
    for number in range(1, 6):
        room = frames.next_frame()
        assert not room.seen.any()
        room.image[region], room.seen[region] = number, 255
        placed = frames.place(room.image[region], room.seen[region], region)
        assert placed is room
        frames.append(placed)
    assert [int(frame.image[1, 2]) for frame in (frames[0], frames[1])] == [4, 5]
    frames.next_frame().image[:] = 77
    elsewhere = np.full((4, 6), 6, np.uint8), np.full((4, 6), 255, np.uint8), np.s_[:4, :6]
    frames.append(frames.place(*elsewhere))
    assert [int(frame.image[1, 2]) for frame in (frames[0], frames[1])] == [5, 6]
    assert frames[1].seen.all()
