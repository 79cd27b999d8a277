"""Tests of the rendered world against its own truth."""

import cv2
import numpy as np
import pytest

from streamkit_video.dronetestsrc.element import load_ground
from streamkit_video.dronetestsrc.world import RenderedFrame, SensorNoise, World, WorldSettings

SIZE = (640, 480)
INVERSE = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


@pytest.fixture(scope="module")
def colour_ground() -> np.ndarray:
    """The shipped photograph."""
    return load_ground(None)


@pytest.fixture(scope="module")
def ground(colour_ground: np.ndarray) -> np.ndarray:
    """The shipped photograph in grey."""
    return cv2.cvtColor(colour_ground, cv2.COLOR_BGR2GRAY)


def render(
    ground: np.ndarray, count: int, size: tuple[int, int] = SIZE, **settings: float
) -> list[RenderedFrame]:
    """The first frames of a world."""
    world = World(ground, size, WorldSettings(**settings))  # type: ignore[arg-type]
    return [world.next_frame() for _ in range(count)]


def away_from_cars(frame: RenderedFrame) -> np.ndarray:
    """Mask of pixels farther than a car and its shadow from any car, and from the border."""
    mask = np.zeros(frame.image.shape[:2], np.uint8)
    mask[20:-20, 20:-20] = 1
    for x, y in frame.targets.centres:
        cv2.circle(mask, (round(x), round(y)), 36, 0, -1)
    return mask.astype(bool)


def test_to_previous_maps_the_ground_onto_the_frame_before(ground: np.ndarray) -> None:
    """Without noise and cars, frame t - 1 sampled at `to_previous` is frame t but for interpolation."""
    frames = render(ground, 40, cars=0, noise=0.0, seed=2)
    for before, after in zip(frames[8::10], frames[9::10], strict=False):
        warped = cv2.warpPerspective(before.image, after.registration.to_previous, SIZE, flags=INVERSE)
        inside = np.s_[20:-20, 20:-20]
        right = np.abs(warped[inside].astype(float) - after.image[inside]).mean()
        shifted = after.registration.to_previous @ np.array(
            [[1.0, 0.0, 0.5], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        )
        wrong = cv2.warpPerspective(before.image, shifted, SIZE, flags=INVERSE)
        assert right < 3.0
        assert np.abs(wrong[inside].astype(float) - after.image[inside]).mean() > 1.2 * right
        (dx, dy), _ = cv2.phaseCorrelate(
            warped[inside].astype(np.float64), after.image[inside].astype(np.float64)
        )
        assert np.hypot(dx, dy) < 0.1


def test_cars_are_the_only_thing_that_moves(ground: np.ndarray) -> None:
    """Frame differences above the noise are at the cars, and at every car."""
    before, after = render(ground, 12, noise=2.0, seed=4)[-2:]
    warped = cv2.warpPerspective(before.image, after.registration.to_previous, SIZE, flags=INVERSE)
    difference = np.abs(warped.astype(float) - after.image)
    ground_only = difference[away_from_cars(after) & away_from_cars(before)]
    assert np.percentile(ground_only, 99.9) < 25.0
    assert len(after.targets) >= 3
    for x, y in after.targets.centres:
        window = difference[max(0, round(y) - 16) : round(y) + 17, max(0, round(x) - 16) : round(x) + 17]
        assert window.max() > 40.0


def test_to_reference_is_the_chain_of_steps(ground: np.ndarray) -> None:
    """Going back step by step leads where `to_reference` does; the first frame has identities."""
    frames = render(ground, 30, size=(160, 120), cars=0)
    np.testing.assert_allclose(frames[0].registration.to_previous, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(frames[0].registration.to_reference, np.eye(3), atol=1e-9)
    chained = np.eye(3)
    for frame in frames:
        chained = chained @ frame.registration.to_previous
        chained /= chained[2, 2]
        np.testing.assert_allclose(frame.registration.to_reference, chained, atol=1e-6)


def test_true_centres_are_where_the_bodies_are(ground: np.ndarray) -> None:
    """A world with cars minus the same world without them: the body's middle is the centre of the truth."""
    flat = np.full_like(ground, 128)
    with_cars = render(flat, 25, noise=0.0, cars=3, seed=9, jitter=2.0)[-1]
    assert len(with_cars.targets) >= 2
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    for (x, y), length, width, angle in zip(
        with_cars.targets.centres,
        with_cars.targets.lengths,
        with_cars.targets.widths,
        with_cars.targets.angles,
        strict=True,
    ):
        along = (columns - x) * np.cos(angle) + (rows - y) * np.sin(angle)
        across = -(columns - x) * np.sin(angle) + (rows - y) * np.cos(angle)
        painted = np.abs(with_cars.image.astype(float) - 128.0) > 12.0
        body = painted & (np.abs(along) < length / 2.0 - 1.5) & (np.abs(across) < width / 2.0 - 1.5)
        rectangle = (np.abs(along) < length / 2.0 - 1.5) & (np.abs(across) < width / 2.0 - 1.5)
        assert body.sum() > 0.9 * rectangle.sum()
        # The side towards the light has no shadow: the body ends at the true box.
        sunny = (across * np.sign(-np.cos(angle)) > width / 2.0 + 1.5) & (np.abs(across) < width)
        assert not (painted & sunny & (np.abs(along) < length / 4.0)).any()


def test_velocities_are_motion_over_the_ground(ground: np.ndarray) -> None:
    """Where a car was a frame ago, seen in this frame, is its centre minus its velocity over the rate."""
    world = World(ground, SIZE, WorldSettings(seed=1, frame_rate=50.0))
    before = world.next_frame()
    compared = 0
    for _ in range(30):
        after = world.next_frame()
        to_now = np.linalg.inv(after.registration.to_previous)
        known = dict(zip(before.targets.ids.tolist(), before.targets.centres, strict=True))
        for identity, centre, velocity in zip(
            after.targets.ids.tolist(), after.targets.centres, after.targets.velocities, strict=True
        ):
            if identity in known:
                was = cv2.perspectiveTransform(known[identity][None, None], to_now)[0, 0]
                np.testing.assert_allclose(centre - was, velocity / 50.0, atol=0.35)
                compared += 1
        before = after
    assert compared > 60


def test_only_whole_bodies_are_targets(ground: np.ndarray) -> None:
    """Every corner of every target's rectangle is in the frame; a car at the border is not a target."""
    fewer = 0
    for frame in render(ground, 120, size=(320, 240), noise=0.0, seed=3):
        targets = frame.targets
        along = (
            np.stack([np.cos(targets.angles), np.sin(targets.angles)], axis=1) * targets.lengths[:, None] / 2
        )
        across = (
            np.stack([-np.sin(targets.angles), np.cos(targets.angles)], axis=1) * targets.widths[:, None] / 2
        )
        for corner in (along + across, along - across, -along + across, -along - across):
            points = targets.centres + corner
            # The truth's corners are those of the projected rectangle, which the tilt shears a little.
            assert (points > -0.5).all()
            assert (points < np.array([319.5, 239.5])).all()
        fewer += len(targets) < 12
        assert (np.diff(targets.ids) > 0).all()
    assert fewer > 0


def test_the_same_settings_give_the_same_frames(ground: np.ndarray) -> None:
    """Bit for bit, with noise, for any number of OpenCV threads; another seed gives other frames."""
    threads = cv2.getNumThreads()
    one = render(ground, 4, seed=5)
    try:
        cv2.setNumThreads(1)
        same = render(ground, 4, seed=5)
    finally:
        cv2.setNumThreads(threads)
    other = render(ground, 4, seed=6)
    for left, right in zip(one, same, strict=True):
        np.testing.assert_array_equal(left.image, right.image)
        np.testing.assert_array_equal(left.targets.centres, right.targets.centres)
        np.testing.assert_array_equal(left.registration.to_reference, right.registration.to_reference)
    assert not np.array_equal(one[3].image, other[3].image)


def test_colour_shows_the_same_world(ground: np.ndarray, colour_ground: np.ndarray) -> None:
    """A world in colour has the truth of the grey one, and its brightness."""
    grey, colour = (render(image, 3, noise=0.0)[-1] for image in (ground, colour_ground))
    np.testing.assert_array_equal(grey.targets.centres, colour.targets.centres)
    difference = cv2.cvtColor(colour.image, cv2.COLOR_BGR2GRAY).astype(int) - grey.image
    assert np.abs(difference).max() <= 4


def test_noise_has_its_deviation_and_no_memory() -> None:
    """White: the requested deviation, mean zero, nothing in common with neighbours or the next frame."""
    noise = SensorNoise(2.0, seed=0)
    one, two = np.full((200, 300), 100, np.uint8), np.full((200, 300), 100, np.uint8)
    noise.add_to(one)
    noise.add_to(two)
    first, second = one.astype(float) - 100.0, two.astype(float) - 100.0
    assert first.std() == pytest.approx(2.0, rel=0.05)
    assert abs(first.mean()) < 0.05
    assert abs((first[:, 1:] * first[:, :-1]).mean()) < 0.1
    assert abs((first * second).mean()) < 0.1


def test_a_tiny_ground_is_refused() -> None:
    """The error names the rule and the size."""
    with pytest.raises(ValueError, match="at least 64x64 px, got 30x20: take a larger one"):
        World(np.zeros((20, 30), np.uint8), SIZE, WorldSettings())
