"""Pixels that flicker."""

import numpy as np

from streamkit_differencer.filters.flicker import update_flicker


def run(signal):
    """What is left out of the foreground of one pixel, frame by frame."""
    restless, before, out = np.zeros((1, 1), np.uint8), np.zeros((1, 1), np.uint8), []
    for value in signal:
        mask = np.full((1, 1), 255 if value else 0, np.uint8)
        out.append(bool(update_flicker(restless, before, mask)[0, 0]))
        before = mask
    return out


def test_what_turns_every_other_frame_is_left_out():
    """A leaf is found out within a dozen frames, and stays so."""
    out = run([time % 4 < 2 for time in range(100)])
    assert not any(out[:4])
    assert all(out[time] for time in range(40, 100) if time % 4 < 2)


def test_passing_vehicles_stay():
    """Two turns a second and a half, of one vehicle after another, are no flicker."""
    assert not any(run([time % 40 < 12 for time in range(400)]))


def test_a_pixel_that_calms_down_counts_again():
    """Some seconds after the wind, a vehicle is seen."""
    signal = [time % 2 == 0 for time in range(60)] + [False] * 150 + [True] * 5
    assert not any(run(signal)[-5:])
