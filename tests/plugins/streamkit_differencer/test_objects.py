"""Objects from foreground."""

from dataclasses import replace

import numpy as np
import pytest

from streamkit_differencer.objects import (
    NO_OBJECTS,
    Objects,
    cells_of,
    find_objects,
    mark_moving,
    most_confident,
)
from streamkit_differencer.settings import Criterion, ObjectSettings


def with_block(shape, x0, y0, x1, y1, value=255):
    """A mask with one block."""
    mask = np.zeros(shape, np.uint8)
    mask[y0:y1, x0:x1] = value
    return mask


@pytest.mark.parametrize("scale", [1, 2, 4])
def test_boxes_and_centroids_are_in_frame_pixels(scale):
    """(0, 0) is the centre of the top-left frame pixel, also after halving: no half pixel is lost."""
    # Frame pixels 40..79 by 16..31, whose outer edges are 39.5..79.5 and 15.5..31.5.
    mask = with_block((120 // scale, 200 // scale), 40 // scale, 16 // scale, 80 // scale, 32 // scale)
    objects = find_objects(mask, scale, ObjectSettings())
    assert objects.boxes.tolist() == [[39.5, 15.5, 79.5, 31.5]]
    assert objects.centroids.tolist() == [[59.5, 23.5]]
    assert objects.areas.tolist() == [640.0]
    assert objects.changes.tolist() == [1.0]


def test_boxes_are_finer_than_cells():
    """A box follows the foreground's own grid, not the cells that were clustered."""
    mask = with_block((60, 60), 11, 13, 30, 22)
    box = find_objects(mask, 1, ObjectSettings()).boxes[0]
    assert box.tolist() == [10.5, 12.5, 29.5, 21.5]


def test_a_lone_pixel_is_voted_down():
    """Sub-sampling is by vote: noise of single pixels leaves no cell."""
    mask = np.zeros((64, 64), np.uint8)
    mask[::8, ::8] = 255
    assert not cells_of(mask, 2).any()
    assert len(find_objects(mask, 2, ObjectSettings(min_area=1))) == 0


def test_fragments_of_one_thing_are_one_object():
    """Two pieces with less than merge_gap cells between them share a box; farther apart they do not."""
    mask = with_block((100, 100), 20, 20, 28, 30) | with_block((100, 100), 34, 20, 40, 30)
    assert len(find_objects(mask, 2, ObjectSettings(merge_gap=4))) == 1
    far = with_block((100, 100), 20, 20, 28, 30) | with_block((100, 100), 50, 20, 56, 30)
    assert len(find_objects(far, 2, ObjectSettings(merge_gap=4))) == 2


def test_two_cars_that_pass_each_other_stay_two():
    """A strip of ground between two objects keeps them apart; a crack in one object does not part it."""
    apart = with_block((100, 100), 20, 20, 40, 30) | with_block((100, 100), 24, 34, 44, 44)
    assert len(find_objects(apart, 2, ObjectSettings())) == 2
    cracked = with_block((100, 100), 20, 20, 40, 44)
    cracked[31, :] = 0
    assert len(find_objects(cracked, 2, ObjectSettings())) == 1


def test_gaps_within_a_thing_are_filled():
    """Foreground in cells that were voted down counts where the object closes around it."""
    ring = with_block((80, 80), 20, 20, 44, 44)
    ring[28:32, 28:32] = 0
    ring[30, 30] = 255
    objects = find_objects(ring, 2, ObjectSettings())
    assert objects.areas.tolist() == [(24 * 24 - 4 * 4 + 1) * 4.0]


def test_scatter_keeps_large_things_apart():
    """By scatter, merging two large objects costs more than by gap."""
    mask = with_block((120, 120), 10, 10, 50, 50) | with_block((120, 120), 56, 10, 96, 50)
    by_gap = find_objects(mask, 2, ObjectSettings(merge_gap=4))
    by_scatter = find_objects(mask, 2, ObjectSettings(merge_gap=4, merge_criterion=Criterion.SCATTER))
    assert (len(by_gap), len(by_scatter)) == (1, 2)


def test_small_objects_are_left_out():
    """An object needs min_area cells."""
    mask = with_block((80, 80), 10, 10, 14, 14)
    assert len(find_objects(mask, 2, ObjectSettings(min_area=4))) == 1
    assert len(find_objects(mask, 2, ObjectSettings(min_area=5))) == 0


def test_what_stands_still_is_left_out():
    """The change is the share of the foreground that changed lately; below min_change nothing is reported."""
    mask = with_block((80, 80), 10, 10, 30, 20, 128)
    assert len(find_objects(mask, 2, ObjectSettings())) == 0
    assert find_objects(mask, 2, ObjectSettings(stopped=True)).changes.tolist() == [0.0]
    mask[10:20, 10:20] = 255
    objects = find_objects(mask, 2, ObjectSettings(min_change=0.5))
    assert objects.changes.tolist() == [0.5]


def test_the_largest_are_kept():
    """Beyond max_objects the smallest go, and they are counted."""
    mask = np.zeros((200, 200), np.uint8)
    for index in range(5):
        mask[40 * index : 40 * index + 8, 20 : 30 + 10 * index] = 255
    objects = find_objects(mask, 2, ObjectSettings(max_objects=2))
    assert objects.areas.tolist() == [8 * 50 * 4.0, 8 * 40 * 4.0]
    assert objects.dropped == 3


def test_of_too_many_the_surest_are_kept():
    """Whatever their size, in the order they were in; the others are counted with those left out before."""
    mask = np.zeros((200, 200), np.uint8)
    for index in range(5):
        mask[40 * index : 40 * index + 8, 20 : 30 + 10 * index] = 255
    found = find_objects(mask, 2, ObjectSettings(max_objects=4))
    judged = replace(found, confidences=np.array([0.2, 0.9, 0.1, 0.8]))
    kept = most_confident(judged, 2)
    assert kept.confidences.tolist() == [0.9, 0.8]
    np.testing.assert_array_equal(kept.boxes, found.boxes[[1, 3]])
    assert kept.dropped == 3


@pytest.mark.parametrize("scale", [1, 2, 4])
@pytest.mark.parametrize("shape", [(1, 1), (1, 37), (41, 1), (45, 67), (90, 160)])
def test_any_shape_and_any_foreground_gives_objects_in_the_frame(scale, shape):
    """Odd sizes, nothing, everything and noise: no error, and every box lies within the frame."""
    random = np.random.default_rng(3)
    noise = np.where(random.random(shape) < 0.3, 255, 0).astype(np.uint8)
    for mask in (np.zeros(shape, np.uint8), np.full(shape, 255, np.uint8), noise):
        objects = find_objects(mask, scale, ObjectSettings(min_area=1))
        assert (objects.boxes[:, :2] >= -0.5).all()
        assert (objects.boxes[:, 2:] <= np.array(shape[::-1]) * scale - 0.5).all()
        assert (objects.boxes[:, :2] <= objects.centroids).all()
        assert (objects.centroids <= objects.boxes[:, 2:]).all()


def test_noise_everywhere_takes_bounded_work():
    """More fragments than can be clustered are cut down to the largest."""
    random = np.random.default_rng(4)
    mask = np.zeros((800, 1200), np.uint8)
    ys, xs = np.mgrid[0:800:8, 0:1200:8]
    for y, x in zip(ys.ravel(), xs.ravel(), strict=True):
        mask[y : y + 2, x : x + 2] = 255 if random.random() < 0.9 else 0
    objects = find_objects(mask, 4, ObjectSettings(min_area=1, merge_gap=1))
    assert 0 < len(objects) <= 400


def test_all_of_what_moves_is_marked_as_moving():
    """Of objects that changed for the most part; of others what stands stays marked as standing."""
    mask = np.zeros((40, 60), np.uint8)
    mask[5:15, 5:25], mask[5:15, 5:17] = 128, 255
    mask[25:35, 5:25], mask[25:35, 5:10] = 128, 255
    before = mask.copy()
    boxes = np.array([[5, 5, 25, 15], [5, 25, 25, 35]]) * 2 - 0.5
    mark_moving(mask, Objects(np.zeros((2, 2)), boxes, np.ones(2), np.array([0.6, 0.25])), 2)
    assert (mask[5:15, 5:25] == 255).all()
    np.testing.assert_array_equal(mask[20:], before[20:])
    assert np.count_nonzero(mask) == np.count_nonzero(before)


def test_nothing_found_leaves_the_mask_alone():
    """Foreground that no object was made of stays as it is."""
    mask = np.full((40, 60), 128, np.uint8)
    mark_moving(mask, NO_OBJECTS, 2)
    assert (mask == 128).all()
