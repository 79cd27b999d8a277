"""The foreground as it is shown."""

import numpy as np

from streamkit_differencer.mask_refinement import refine_mask
from streamkit_differencer.objects import Objects

SHAPE = (40, 60)


def objects(*boxes, scores, scale=2):
    """Objects with boxes in working pixels."""
    count = len(boxes)
    edges = np.array(boxes, float) * scale - 0.5
    return Objects(np.zeros((count, 2)), edges, np.ones(count), np.array(scores))


def shown(mask, image, found, has_halo=True, shift=(0, 0), scale=2):
    """The mask over plain ground of 100 that lies elsewhere than the frame."""
    ground = np.full((60, 90), 100, np.uint8)
    to_ground = np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1.0]])
    refine_mask(mask, found, image, ground, to_ground, scale, has_halo)
    return mask


def test_all_of_what_moves_is_marked_as_moving():
    """Of objects that changed for the most part; of others what stands stays marked as standing."""
    mask = np.zeros(SHAPE, np.uint8)
    mask[5:15, 5:25], mask[5:15, 5:17] = 128, 255
    mask[25:35, 5:25], mask[25:35, 5:10] = 128, 255
    before = mask.copy()
    image = np.where(mask > 0, 200, 100).astype(np.uint8)
    found = objects((5, 5, 25, 15), (5, 25, 25, 35), scores=[0.6, 0.25])
    shown(mask, image, found)
    assert (mask[5:15, 5:25] == 255).all()
    np.testing.assert_array_equal(mask[20:], before[20:])
    assert np.count_nonzero(mask) == np.count_nonzero(before)


def test_the_halo_of_a_thing_is_no_foreground():
    """Edge pixels with hardly any contrast go, whole edges and grey middles stay; shadow is left alone."""
    image = np.full(SHAPE, 100, np.uint8)
    image[10:20, 10:30] = 180
    image[13:17, 15:20] = 101
    mask = np.zeros(SHAPE, np.uint8)
    mask[9:21, 9:31] = 255
    mask[9:21, 31:34] = 50
    thing = np.zeros(SHAPE, bool)
    thing[10:20, 10:30] = True
    found = objects((9, 9, 31, 21), scores=[1.0])
    kept = shown(mask.copy(), image, found, has_halo=False)
    np.testing.assert_array_equal(kept, mask)
    trimmed = shown(mask.copy(), image, found)
    np.testing.assert_array_equal(trimmed == 255, thing)
    np.testing.assert_array_equal(trimmed == 50, mask == 50)


def test_the_ground_is_asked_where_the_frame_lies_on_it():
    """Ground with a bright part: the object's contrast is that to what it covers."""
    ground = np.full((60, 90), 100, np.uint8)
    ground[:, 45:] = 200
    image = ground[5:45, 20:80].copy()
    image[10:20, 10:40] = 150
    mask = np.zeros(SHAPE, np.uint8)
    mask[9:21, 9:41] = 255
    thing = np.zeros(SHAPE, bool)
    thing[10:20, 10:40] = True
    to_ground = np.array([[1, 0, 20], [0, 1, 5], [0, 0, 1.0]])
    refine_mask(mask, objects((9, 9, 41, 21), scores=[1.0]), image, ground, to_ground, 2, True)
    np.testing.assert_array_equal(mask == 255, thing)


def test_boxes_beyond_the_picture_are_cut():
    """An object at the border keeps its edge there."""
    image = np.full(SHAPE, 200, np.uint8)
    mask = np.full(SHAPE, 255, np.uint8)
    shown(mask, image, objects((-3, -2, 70, 50), scores=[1.0]))
    assert (mask == 255).all()


def test_nothing_found_leaves_the_mask_alone():
    """Foreground that no object was made of stays as it is."""
    mask = np.full(SHAPE, 128, np.uint8)
    none = Objects(np.zeros((0, 2)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))
    shown(mask, mask.copy(), none)
    assert (mask == 128).all()
