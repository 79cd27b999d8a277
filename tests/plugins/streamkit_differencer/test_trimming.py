"""What surrounds an object is removed from the foreground."""

import cv2
import numpy as np

from streamkit_differencer.filters.components import components_of
from streamkit_differencer.trimming import HALO_SHARE, SHADOW_SHARE, object_contrasts, trim

SHAPE = (40, 60)


def trimmed(mask, image, halo_share=0.0, shadow_share=0.0, shift=(0, 0), ground=None):
    """The mask over ground, plain 100 by default, that lies elsewhere than the frame."""
    ground = np.full((60, 90), 100, np.uint8) if ground is None else ground
    to_ground = np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1.0]])
    result = mask.copy()
    blocks, count = components_of(result)
    contrasts = object_contrasts(result, image, ground, to_ground, blocks, count)
    trim(result, image, blocks, *contrasts, halo_share, shadow_share)
    return result


def test_halo_is_no_foreground():
    """Edge pixels with hardly any contrast go, whole edges and grey middles stay; shadow is left alone."""
    image = np.full(SHAPE, 100, np.uint8)
    image[10:20, 10:30] = 180
    image[13:17, 15:20] = 101
    mask = np.zeros(SHAPE, np.uint8)
    mask[9:21, 9:31] = 255
    mask[9:21, 31:34] = 50
    thing = np.zeros(SHAPE, bool)
    thing[10:20, 10:30] = True
    np.testing.assert_array_equal(trimmed(mask, image), mask)
    result = trimmed(mask, image, HALO_SHARE)
    np.testing.assert_array_equal(result == 255, thing)
    np.testing.assert_array_equal(result == 50, mask == 50)


def test_background_is_taken_where_the_frame_lies_on_it():
    """Ground with a bright part: the object's contrast is that to what it covers."""
    ground = np.full((60, 90), 100, np.uint8)
    ground[:, 45:] = 200
    image = ground[5:45, 20:80].copy()
    image[10:20, 10:40] = 150
    mask = np.zeros(SHAPE, np.uint8)
    mask[9:21, 9:41] = 255
    thing = np.zeros(SHAPE, bool)
    thing[10:20, 10:40] = True
    result = trimmed(mask, image, HALO_SHARE, shift=(20, 5), ground=ground)
    np.testing.assert_array_equal(result == 255, thing)


def test_foreground_at_the_border_stays():
    """An object that fills the frame has no edge."""
    mask = np.full(SHAPE, 255, np.uint8)
    result = trimmed(mask, np.full(SHAPE, 200, np.uint8), HALO_SHARE, SHADOW_SHARE)
    np.testing.assert_array_equal(result, mask)


def test_soft_shadow_between_two_objects_is_no_foreground():
    """Two dark people stand in the shadow that joins them; the texture of the ground shows in it."""
    ground = np.full((60, 90), 100, np.uint8)
    ground[::3] = 120
    image = ground[:40, :60].copy()
    image[25:33] = np.rint(image[25:33] * 0.88)
    people = np.zeros(SHAPE, bool)
    people[8:30, 12:20] = people[8:30, 28:36] = True
    image[people] = 20
    mask = np.where(people, 255, 0).astype(np.uint8)
    mask[25:33, 8:40] = 255
    result = trimmed(mask, image, shadow_share=SHADOW_SHARE, ground=ground)
    assert cv2.connectedComponents(result)[0] == 1 + 2
    assert (result[people] == 255).all()
    near = cv2.dilate(people.astype(np.uint8), np.ones((3, 3))) > 0
    assert not result[~near].any()


def test_dark_parts_of_an_object_are_no_shadow():
    """A car that is as dark as a shadow stays whole, and so does a rough part of a darker one."""
    mask = np.zeros(SHAPE, np.uint8)
    mask[10:20, 10:30] = 255
    image = np.full(SHAPE, 100, np.uint8)
    image[10:20, 10:30] = 85
    np.testing.assert_array_equal(trimmed(mask, image, shadow_share=SHADOW_SHARE), mask)
    image[10:20, 10:30] = 20
    image[10:20:2, 10:30:2] = 95
    np.testing.assert_array_equal(trimmed(mask, image, shadow_share=SHADOW_SHARE), mask)
