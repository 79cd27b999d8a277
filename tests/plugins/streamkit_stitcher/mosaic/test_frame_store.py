"""Frames stored for the final mosaic."""

import numpy as np

from streamkit_stitcher.mosaic.frame_store import FrameStore


def test_frames_come_back(ground):
    """In memory as they were, from the file nearly so; the order is that of their coming."""
    frame = ground[:360, :640]
    store = FrameStore(memory_bytes=2 * frame.nbytes)
    numbers = [store.add(np.roll(frame, 10 * shift)) for shift in range(4)]
    assert numbers == [0, 1, 2, 3]
    for number in (3, 0, 2, 1, 2):
        difference = np.abs(store.get(number).astype(int) - np.roll(frame, 10 * number))
        assert difference.mean() < (0.001 if number < 2 else 2.0)
    store.close()
    assert len(store) == 0


def test_a_kept_frame_is_a_copy(ground):
    """What happens to the frame afterwards does not matter."""
    frame = ground[:360, :640].copy()
    store = FrameStore()
    store.add(frame)
    frame[:] = 0
    assert store.get(0).max() > 0


def test_beyond_the_limit_frames_are_refused(ground):
    """The file does not grow for ever."""
    store = FrameStore(memory_bytes=0, file_bytes=1000)
    assert store.add(ground[:360, :640]) is None
    store.close()
