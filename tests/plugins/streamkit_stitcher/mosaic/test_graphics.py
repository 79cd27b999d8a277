"""Graphics over the ground: found, and kept out of the mosaic."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit_stitcher.mosaic.graphics import OverlaidGraphics
from streamkit_stitcher.mosaic.recorder import MosaicRecorder
from streamkit_stitcher.mosaic.settings import RecorderSettings
from streamkit_stitcher.plane.frame_registration import FrameRegistration

SHAPE = (360, 640)
STEP = 12


def views(ground, count=40, shown=lambda _: True):
    """Frames of a flight to the right, with a logo in those that `shown` selects, and where the logo is."""
    logo = np.zeros(SHAPE, np.uint8)
    cv2.circle(logo, (70, 290), 45, 1, -1)
    frames = []
    for number in range(count):
        view = ground[:360, STEP * number : STEP * number + 640].copy()
        if shown(number):
            view[logo > 0] = 60
            cv2.putText(view, "ACME", (32, 298), cv2.FONT_HERSHEY_SIMPLEX, 0.8, 240, 2)
        frames.append(view)
    return frames, logo > 0


def found(frames):
    """The mask after all frames."""
    graphics = OverlaidGraphics()
    for frame in frames:
        graphics.add(frame)
    return graphics.mask(SHAPE)


@pytest.mark.parametrize("shown", [lambda _: True, lambda number: number % 20 < 14])
def test_a_logo_is_found_and_filled(ground, shown):
    """Also one that comes and goes; hardly anything else is taken for graphics."""
    frames, logo = views(ground, shown=shown)
    mask = found(frames)
    assert mask[logo].mean() > 0.98
    near = cv2.dilate(logo.astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    assert mask[~near].mean() < 0.002


def test_without_graphics_next_to_nothing_is_masked(ground):
    """A pixel of the ground is alike from frame to frame by chance only."""
    mask = found(views(ground, shown=lambda _: False)[0])
    assert mask is None or mask.mean() < 0.002


def test_a_few_frames_are_no_evidence(ground):
    """Nor are frames of another size."""
    frames, _ = views(ground, 12)
    assert found(frames) is None
    frames, _ = views(ground)
    assert found([*frames, frames[0][:300]]) is None


def test_the_mosaic_shows_the_ground_under_a_logo(ground, tmp_path):
    """Wherever another frame shows it."""
    frames, _ = views(ground)
    path = tmp_path / "m.png"
    recorder = MosaicRecorder(RecorderSettings(str(path)))
    places = {}
    for number, frame in enumerate(frames):
        places[number] = translation(np.array([float(STEP * number), 0.0]))
        before = translation(np.array([float(STEP), 0.0])) if number else np.eye(3)
        registered = FrameRegistration(
            before,
            places[number],
            0,
            RegistrationStatus.OK,
            keyframe=number % 8 == 0,
            key_index=number,
            measured=True,
        )
        recorder.add(registered, SHAPE, lambda frame=frame: frame)
    recorder.finish({0: places})
    mosaic = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    apart = np.abs(mosaic[:, 130:1000].astype(int) - ground[:360, 130:1000])
    assert (apart > 40).mean() < 0.001
