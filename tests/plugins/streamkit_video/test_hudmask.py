"""hudmask: what it marks, and what framediff and stitch then leave out."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from streamkit import (
    Caps,
    Detections,
    Frame,
    HiddenPixels,
    Pipeline,
    Registration,
    ResourceError,
    raw_video_caps,
)
from streamkit.testing import Harness
from streamkit_kernels.hidden_pixels import without_hidden
from streamkit_stitcher.mosaic.graphics import OverlaidGraphics
from streamkit_video.hudmask import rectangles

GREY = Frame(np.zeros((60, 80), np.uint8), raw_video_caps("GRAY8", 80, 60), pts=0)


def mask_of(**properties: object) -> np.ndarray:
    """The mask on a frame of 80 x 60 px."""
    with Harness("hudmask", **properties) as harness:
        (passed,) = harness.push(GREY)
    assert passed.data is GREY.data
    hidden = passed.get(HiddenPixels)
    assert hidden is not None
    return hidden.mask


def test_rectangles_in_pixels_and_shares() -> None:
    """Each kind for itself; a rectangle may reach beyond the frame."""
    assert rectangles("0,0,1,0.1; 70, 50, 100, 100", 80, 60) == [(0, 0, 80, 6), (70, 50, 170, 150)]
    mask = mask_of(areas="0,0,1,0.1; 70,50,100,100", margin=0)
    expected = np.zeros((60, 80), np.uint8)
    expected[:6], expected[50:, 70:] = 255, 255
    np.testing.assert_array_equal(mask, expected)


def test_an_image_is_scaled_and_widened(tmp_path: Path) -> None:
    """White is hidden; the margin is added on each side."""
    image = np.zeros((30, 40), np.uint8)
    image[10:20, 10:20] = 255
    cv2.imwrite(str(tmp_path / "hud.png"), image)
    mask = mask_of(location=str(tmp_path / "hud.png"), margin=3)
    assert cv2.boundingRect(mask) == (17, 17, 26, 26)


@pytest.mark.parametrize(
    ("properties", "rule"),
    [
        ({}, "areas= or location= must say where the graphics are; write areas="),
        ({"areas": "1,2,3"}, "'1,2,3' must be x,y,width,height from 0"),
        ({"areas": "0,0,-1,5"}, "height from 0"),
        ({"areas": "0,0,nan,5"}, "must be x,y,width,height"),
        ({"areas": "left"}, "'left' must be x,y,width,height"),
        ({"location": "no-such.png"}, "no-such.png: not an image that can be read"),
    ],
)
def test_what_marks_nothing_is_refused(properties: dict[str, str], rule: str) -> None:
    """Before the first frame."""
    with pytest.raises(ResourceError, match=rule), Harness("hudmask", **properties):
        pass


def test_the_mask_follows_a_smaller_frame() -> None:
    """Videoscale and videocrop carry it along."""
    text = (
        "videotestsrc num-buffers=1 ! video/x-raw,width=320,height=240 ! hudmask margin=0 areas=40,20,100,60 "
        "! videocrop left=20 ! videoscale ! video/x-raw,width=150,height=120 ! appsink name=out"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frame = next(iter(pipeline["out"]))
    assert frame.get(HiddenPixels).mask.shape == (120, 150)
    left, top, width, height = cv2.boundingRect(frame.get(HiddenPixels).mask)
    assert np.abs(np.array([left, top, width, height]) - (10, 10, 50, 30)).max() <= 1


def test_a_real_flight_with_a_clock(streamkit_data: Path) -> None:
    """Framediff takes the clock of a HUD for movers; behind hudmask it finds what it finds without a HUD."""
    source = f"filesrc location={streamkit_data / 'telemetry' / 'sample-stream.ts'} stop-s=2 ! decode"
    clock = "! timeoverlay valignment=top halignment=left"
    mask = "! hudmask areas=0,0,1,0.12"

    def boxes(middle: str) -> tuple[int, int]:
        """Number of detections at the top, and of others."""
        text = f"{source} ! video/x-raw,format=GRAY8 {middle} ! stitch ! framediff ! appsink name=out"
        found = []
        with Pipeline.parse(text) as pipeline:
            pipeline.play()
            for frame in pipeline["out"]:
                assert frame.get(Registration).status != "lost"
                found += frame.get(Detections).boxes.tolist()
        at_top = sum(box[1] < 0.12 * 480 for box in found)
        return at_top, len(found) - at_top

    plain, with_clock, masked = boxes(""), boxes(clock), boxes(f"{clock} {mask}")
    assert with_clock[0] > 20
    assert masked[0] == 0
    assert abs(masked[1] - plain[1]) <= 0.1 * plain[1]


PANEL = "dronetestsrc num-buffers=25 seed=2 ! video/x-raw,format=GRAY8 ! appsink name=out"


def test_a_still_panel_does_not_decide_the_motion() -> None:
    """Where it takes half of the frame, the ground below is registered as if it were alone."""
    from streamkit.geometry.homography import project
    from streamkit_stitcher.plane.registrar import FrameRegistrar
    from streamkit_stitcher.plane.settings import PlaneSettings
    from streamkit_video.dronetestsrc.truth import TrueRegistration

    registrar, errors, panel = FrameRegistrar(PlaneSettings()), [], None
    with Pipeline.parse(PANEL) as pipeline:
        pipeline.play()
        for frame in pipeline["out"]:
            grey = frame.data.copy()
            height, width = grey.shape
            panel = grey[: height // 2].copy() if panel is None else panel
            grey[: height // 2] = panel
            hidden = np.zeros_like(grey)
            hidden[: height // 2] = 255
            found = registrar.register(without_hidden(grey, hidden))
            outline = np.array([[0, height / 2], [width, height / 2], [width, height], [0, height]])
            true = frame.get(TrueRegistration).to_previous
            errors.append(np.abs(project(found.to_previous, outline) - project(true, outline)).max())
    registrar.close()
    assert np.median(errors) < 0.15
    assert max(errors) < 0.6


def test_without_hidden_is_smooth_and_changes_nothing_else() -> None:
    """No texture where it was hidden; a whole frame may be, too."""
    generator = np.random.default_rng(1)
    grey = generator.integers(80, 160, (120, 160), np.uint8)
    hidden = np.zeros_like(grey)
    hidden[40:80, 50:110] = 255
    found = without_hidden(grey, hidden)
    np.testing.assert_array_equal(found[hidden == 0], grey[hidden == 0])
    assert np.abs(np.diff(found[42:78, 52:108].astype(int))).max() <= 4
    assert without_hidden(grey, np.full_like(grey, 255)).std() == 0


def test_the_mosaic_shows_other_frames_there() -> None:
    """What is given counts from the first frame on, for frames of its size."""
    graphics = OverlaidGraphics()
    graphics.given = np.eye(20, dtype=np.uint8) * 255
    found = graphics.mask((20, 20))
    assert found is not None
    assert found.sum() == 20
    assert graphics.mask((10, 10)) is None


def test_the_mask_crosses_to_a_process() -> None:
    """A bin in a process of its own gets it."""
    text = (
        "videotestsrc num-buffers=2 ! video/x-raw,width=64,height=48,format=GRAY8 ! hudmask areas=0,0,64,10 "
        "margin=0 ! ( process=true identity ) ! appsink name=out"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        found = [frame.get(HiddenPixels).mask for frame in pipeline["out"]]
    assert [int((mask > 0).sum()) for mask in found] == [640, 640]


def test_caps_of_a_new_size_make_a_new_mask() -> None:
    """Shares are of the frame that comes."""
    with Harness("hudmask", areas="0,0,0.5,0.5", margin=0) as harness:
        for width, height in ((80, 60), (40, 20)):
            caps = Caps(f"video/x-raw, format=GRAY8, width={width}, height={height}")
            (passed,) = harness.push(Frame(np.zeros((height, width), np.uint8), caps, pts=0))
            assert (passed.get(HiddenPixels).mask > 0).sum() == width * height / 4
