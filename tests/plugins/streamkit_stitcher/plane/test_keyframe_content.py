"""What is kept of a keyframe's pixels."""

import numpy as np

from streamkit_stitcher.plane.keyframe_content import LEVELS, keyframe_content
from streamkit_stitcher.registration.patches import pyramid


def test_patches_lie_around_corners_on_whole_pixels(ground):
    """One for each corner and pyramid level, cut from the level's own pixels."""
    images = pyramid((ground[:720, :1280],), LEVELS)
    kept = keyframe_content(images[:2], 1)
    assert len(kept.fine) > 200
    for patches, centres, level in (
        (kept.fine, kept.fine_centres, 1),
        (kept.coarse, kept.coarse_centres, 2),
    ):
        assert patches.shape == (len(kept.fine), 17, 17)
        assert np.array_equal(centres, np.rint(centres))
        inside = (np.abs(centres - centres.mean(axis=0)) < centres.max() / 4).all(axis=1)
        number = np.flatnonzero(inside)[10]
        x, y = centres[number].astype(int)
        assert np.array_equal(patches[number], images[level][y - 8 : y + 9, x - 8 : x + 9])
    assert np.array_equal(kept.small, images[1])


def test_leading_parts_of_the_patches_are_spread(ground):
    """The first fortieth reaches into every quarter of the frame."""
    centres = keyframe_content((ground[:720, :1280],), 0).fine_centres[:10]
    assert len({(x > 320, y > 180) for x, y in centres}) == 4
