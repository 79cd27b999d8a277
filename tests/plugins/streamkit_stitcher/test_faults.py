"""The fault script: what must not happen to a flight, and what stitch says when it does."""

import cv2
import numpy as np
import pytest

from streamkit import Frame, Registration, RegistrationStatus, raw_video_caps
from streamkit.testing import Harness

SHAPE = (360, 640)
SOUND = 4
OK, STILL = RegistrationStatus.OK, RegistrationStatus.STILL
WEAK, LOST, CUT = RegistrationStatus.WEAK, RegistrationStatus.LOST, RegistrationStatus.CUT


@pytest.fixture(scope="module")
def flight(ground, make_flight):
    """A short flight of small frames with cars."""
    return make_flight(ground, 400, SHAPE, cars=6)


def constant(level):
    """Every pixel alike."""
    return lambda frame, random: np.full_like(frame, level)


def dark(frame, random):
    """Nothing but a little sensor noise."""
    return np.abs(random.normal(0, 3, frame.shape)).astype(np.uint8)


def snow(frame, random):
    """A receiver without a signal."""
    return random.integers(0, 256, frame.shape, dtype=np.uint8)


def gain(factor):
    """Another exposure."""
    return lambda frame, random: np.clip(frame * factor, 0, 255).astype(np.uint8)


def blur(deviation):
    """Out of focus."""
    return lambda frame, random: cv2.GaussianBlur(frame, (0, 0), deviation)


def smear(length):
    """Moved while the shutter was open."""
    return lambda frame, random: cv2.blur(frame, (length, 1))


def salt_and_pepper(share):
    """Some pixels black or white."""

    def hit(frame, random):
        chance = random.random(frame.shape)
        return np.where(chance < share / 2, 0, np.where(chance > 1 - share / 2, 255, frame)).astype(np.uint8)

    return hit


def movers(side):
    """All that is in view moves, each block its own way."""

    def moved(frame, random):
        out = frame.copy()
        height, width = frame.shape
        for top in range(0, height, side):
            for left in range(0, width, side):
                across, down = random.integers(-12, 13, 2)
                rows = np.clip(np.arange(top, min(top + side, height)) + down, 0, height - 1)
                columns = np.clip(np.arange(left, min(left + side, width)) + across, 0, width - 1)
                out[top : top + side, left : left + side] = frame[np.ix_(rows, columns)]
        return out

    return moved


def place(harness, frame, seq):
    """The registration that stitch attaches to a frame; finite whatever it shows."""
    height, width = frame.shape
    (frame,) = harness.push(Frame(frame, raw_video_caps("GRAY8", width, height), seq=seq))
    found = frame.get(Registration)
    assert np.isfinite(found.to_reference).all()
    assert np.isfinite(found.to_previous).all()
    return found


@pytest.mark.parametrize(
    ("fault", "repeats", "statuses"),
    [
        pytest.param(constant(0), 5, {LOST}, id="black"),
        pytest.param(constant(128), 5, {LOST}, id="flat"),
        pytest.param(constant(255), 2, {LOST}, id="white"),
        pytest.param(dark, 2, {LOST}, id="dark"),
        pytest.param(snow, 5, {LOST}, id="snow"),
        pytest.param(gain(1.35), 1, {OK}, id="gain up"),
        pytest.param(gain(0.5), 3, {OK}, id="gain down"),
        pytest.param(blur(2.0), 1, {OK, WEAK}, id="soft"),
        pytest.param(blur(8.0), 5, {WEAK, LOST}, id="blur burst"),
        pytest.param(blur(25.0), 5, {WEAK, LOST}, id="wild blur burst"),
        pytest.param(smear(41), 5, {WEAK, LOST}, id="motion blur burst"),
        pytest.param(salt_and_pepper(0.1), 1, {OK, WEAK}, id="little salt and pepper"),
        pytest.param(salt_and_pepper(0.4), 3, {WEAK, LOST}, id="salt and pepper"),
        pytest.param(movers(80), 3, {WEAK, LOST}, id="all moves in blocks"),
        pytest.param(movers(40), 3, {WEAK, LOST}, id="all moves in small blocks"),
    ],
)
def test_a_fault_has_its_status_and_the_second_good_frame_is_ok(flight, fault, repeats, statuses):
    """Nothing raises, nothing is NaN, no wrong homography is called ok, and plane and accuracy survive."""
    random = np.random.default_rng(7)
    with Harness("stitch") as harness:
        for index in range(SOUND):
            assert place(harness, flight.frame(index), index).status in {OK, STILL}
        for index in range(SOUND, SOUND + repeats):
            found = place(harness, fault(flight.frame(index), random), index)
            assert found.status in statuses
            if found.status in {OK, STILL}:
                assert flight.error(found.to_reference, index) < 2.5
        first = SOUND + repeats
        after = [place(harness, flight.frame(index), index) for index in range(first, first + 3)]
    assert [found.status for found in after[1:]] == [OK, OK]
    for index, found in enumerate(after[1:], first + 1):
        assert found.reference == 0
        assert flight.error(found.to_reference, index) < 0.6


def test_one_frame_is_registered(flight):
    """A stream of a single frame: ok, on its own plane."""
    with Harness("stitch") as harness:
        found = place(harness, flight.frame(0), 0)
        harness.drain()
    assert (found.status, found.keyframe, found.reference) == (OK, True, 0)
    assert np.array_equal(found.to_reference, np.eye(3))


def test_a_new_size_is_a_cut_and_ok_at_once(flight):
    """1280x720 to 960x540 in mid stream, at half scale: another plane, on which the next frame is ok."""
    with Harness("stitch") as harness:
        for index in range(3):
            place(harness, flight.frame(index), index)
        small = [cv2.resize(flight.frame(3 + index), (480, 270)) for index in range(2)]
        found = [place(harness, frame, 3 + index) for index, frame in enumerate(small)]
    assert [(item.status, item.reference) for item in found] == [(CUT, 1), (OK, 1)]


def test_another_scene_is_a_cut_and_ok_at_once(ground, flight):
    """A cut opens a plane; a gain step and a blur, as different, do not."""
    with Harness("stitch") as harness:
        for index in range(3):
            place(harness, flight.frame(index), index)
        scene = [ground[1100 + 3 * step : 1460 + 3 * step, 100:740].copy() for step in range(2)]
        found = [place(harness, frame, 3 + index) for index, frame in enumerate(scene)]
    assert [(item.status, item.reference) for item in found] == [(CUT, 1), (OK, 1)]
    assert found[1].to_reference[:2, 2] == pytest.approx([0.0, 3.0], abs=0.1)


def test_a_fault_at_the_very_start_only_delays(flight):
    """Black and flat frames before anything else are lost; the first good one opens plane 0."""
    with Harness("stitch") as harness:
        for seq, level in enumerate((0, 128, 255)):
            assert place(harness, np.full(SHAPE, level, np.uint8), seq).status == LOST
        found = [place(harness, flight.frame(index), 3 + index) for index in range(2)]
    assert [(item.status, item.reference) for item in found] == [(OK, 0), (OK, 0)]
