"""Planes that are used again."""

import numpy as np

from streamkit_differencer.scratch import Scratch


def test_a_name_is_one_memory_whatever_the_shape():
    """Smaller and slightly larger planes of a name lie in the same memory; other names do not."""
    scratch = Scratch()
    first = scratch.plane("mask", (40, 60))
    second = scratch.plane("mask", (41, 59))
    assert second.shape == (41, 59)
    assert second.flags.c_contiguous
    assert np.shares_memory(first, second)
    assert not np.shares_memory(second, scratch.plane("other", (41, 59)))


def test_a_plane_grows_where_it_must():
    """A frame that is much larger gets a plane of its size."""
    scratch = Scratch()
    scratch.plane("mask", (4, 6))
    assert scratch.plane("mask", (400, 600)).shape == (400, 600)
