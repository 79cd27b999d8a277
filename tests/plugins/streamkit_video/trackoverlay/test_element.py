"""Tests of trackoverlay in pipelines."""

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from streamkit import (
    DescriptionError,
    Detections,
    Frame,
    Pipeline,
    Registration,
    RegistrationStatus,
    StreamkitError,
    Track,
    Tracks,
    TrackState,
    raw_video_caps,
)
from streamkit.testing import Harness
from streamkit_video.trackoverlay.drawing import identity_colour

CAPS = raw_video_caps("BGR", 160, 120)
PLAIN = {"labels": False, "status": False, "covariance": 0.0}


def track(identity: int, x: float, y: float, state: TrackState = TrackState.CONFIRMED) -> Track:
    """A target of 30 by 16 px."""
    return Track(identity, state, x, y, 30.0, 16.0, 0.0, (0.0, 0.0), np.eye(2), 1.0, 0)


def frame(*items: object, pts: int = 0) -> Frame:
    """A grey frame with metadata."""
    return Frame(np.full((120, 160, 3), 90, np.uint8), CAPS, pts=pts).attach(*items)


def changed(image: np.ndarray) -> np.ndarray:
    """Mask of pixels drawn."""
    return (image != 90).any(axis=2)


def test_boxes_have_the_colour_of_their_ids() -> None:
    """Each confirmed track is outlined in its colour where it is; the input frame is not written."""
    incoming = frame(Tracks((track(1, 50.0, 40.0), track(2, 110.0, 80.0))))
    with Harness("trackoverlay", **PLAIN) as harness:
        (out,) = harness.push(incoming)
    assert out.data[32, 50].tolist() == list(identity_colour(1))
    assert out.data[72, 110].tolist() == list(identity_colour(2))
    assert not changed(out.data)[40, 50]
    assert not changed(incoming.data).any()
    assert not out.data.flags.writeable


@pytest.mark.parametrize(
    ("state", "tentative", "drawn"),
    [
        (TrackState.CONFIRMED, False, True),
        (TrackState.COASTING, False, True),
        (TrackState.TENTATIVE, False, False),
        (TrackState.TENTATIVE, True, True),
        (TrackState.LOST, True, False),
    ],
)
def test_states(state: TrackState, tentative: bool, drawn: bool) -> None:
    """Tentative tracks show on request, lost ones never."""
    with Harness("trackoverlay", tentative=tentative, **PLAIN) as harness:
        (out,) = harness.push(frame(Tracks((track(1, 50.0, 40.0, state),))))
    assert changed(out.data).any() == drawn


def test_trails_stay_on_the_ground() -> None:
    """The camera moves by 20 px: the trail leads to where the old place is now, not where it was."""
    to_previous = np.array([[1.0, 0.0, 20.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    with Harness("trackoverlay", **PLAIN) as harness:
        harness.push(frame(Tracks((track(1, 120.0, 60.0),))))
        moved = frame(Tracks((track(1, 60.0, 60.0),)), Registration(to_previous, to_previous), pts=1)
        harness.push(moved)
        away = frame(Tracks((track(1, 30.0, 100.0),)), Registration(np.eye(3), np.eye(3)), pts=2)
        (out,) = harness.push(away)
    drawn = changed(out.data)
    assert drawn[60, 65:99].all()
    assert not drawn[60, 103:].any()


@pytest.mark.parametrize("status", [RegistrationStatus.LOST, RegistrationStatus.CUT])
def test_trails_end_where_the_ground_is_lost(status: RegistrationStatus) -> None:
    """A cut clears the trails."""
    with Harness("trackoverlay", **PLAIN) as harness:
        harness.push(frame(Tracks((track(1, 120.0, 20.0),))))
        (out,) = harness.push(
            frame(Tracks((track(1, 40.0, 90.0),)), Registration(np.eye(3), np.eye(3), status=status), pts=1)
        )
    assert not changed(out.data)[:75].any()


def test_trails_are_as_long_as_asked() -> None:
    """Places older than `trails` seconds are gone, and 0 draws none."""
    for seconds, oldest in ((10.0, 10), (2.5, 50), (0.0, 80)):
        with Harness("trackoverlay", trails=seconds, **PLAIN) as harness:
            for number in range(5):
                tracks = Tracks((track(1, 30.0, 10.0 + 20.0 * number),))
                (out,) = harness.push(frame(tracks, pts=number * 1_000_000_000))
        (drawn,) = np.nonzero(changed(out.data)[:, 30])
        assert abs(int(drawn.min()) - oldest) <= 2


def test_a_trail_is_drawn_with_its_target() -> None:
    """None where the target is not shown, for a while or for good; with it the old positions are back."""
    with Harness("trackoverlay", trails=10.0, **PLAIN) as harness:
        harness.push(frame(Tracks((track(1, 30.0, 10.0),))))
        harness.push(frame(Tracks((track(1, 30.0, 50.0),)), pts=1_000_000_000))
        (without,) = harness.push(frame(Tracks(()), pts=2_000_000_000))
        (back,) = harness.push(frame(Tracks((track(1, 30.0, 90.0),)), pts=3_000_000_000))
    assert not changed(without.data).any()
    assert changed(back.data)[12:48, 30].all()


def test_the_ellipse_shows_how_well_a_place_is_known() -> None:
    """Two deviations along each axis of the covariance, turned with it; none where it is off or not known."""
    along, across = np.array([0.8, 0.6]), np.array([-0.6, 0.8])
    covariance = 20.0**2 * np.outer(along, along) + 4.0**2 * np.outer(across, across)
    there = track(1, 80.0, 60.0)
    masks = []
    for deviations, known in ((0.0, covariance), (2.0, covariance), (2.0, np.full((2, 2), np.nan))):
        with Harness("trackoverlay", **{**PLAIN, "covariance": deviations}) as harness:
            (out,) = harness.push(frame(Tracks((dataclasses.replace(there, covariance=known),))))
        masks.append(changed(out.data))
    ellipse = masks[1] & ~masks[0]
    for end in (np.array([80.0, 60.0]) + 40.0 * along, np.array([80.0, 60.0]) - 8.0 * across):
        x, y = np.rint(end).astype(int)
        assert ellipse[y - 1 : y + 2, x - 1 : x + 2].any()
    assert not ellipse[:20].any()
    assert np.array_equal(masks[0], masks[2])


def test_detections_show_on_request() -> None:
    """Boxes of detections are thin and drawn on request only."""
    item = Detections(np.zeros((1, 2)), np.array([[20.0, 30.0, 60.0, 70.0]]), np.ones(1), np.ones(1))
    for wanted in (False, True):
        with Harness("trackoverlay", detections=wanted, **PLAIN) as harness:
            (out,) = harness.push(frame(item))
        assert changed(out.data).any() == wanted
    assert changed(out.data)[30, 40]


def test_labels_and_status_can_be_switched_off() -> None:
    """Each adds its own pixels."""
    counts = []
    for labels, status in ((False, False), (True, False), (True, True)):
        with Harness("trackoverlay", labels=labels, status=status) as harness:
            (out,) = harness.push(frame(Tracks((track(1, 80.0, 60.0),))))
        counts.append(int(changed(out.data).sum()))
    assert counts[0] < counts[1] < counts[2]


def test_the_snapshot_is_the_last_frame_with_a_confirmed_track(tmp_path: Path) -> None:
    """At EOS the file holds that frame as it was drawn; later frames without tracks do not count."""
    target = tmp_path / "shot.png"
    with Harness("trackoverlay", snapshot=str(target), **PLAIN) as harness:
        harness.push(frame(Tracks((track(1, 50.0, 40.0),))))
        (kept,) = harness.push(frame(Tracks((track(1, 60.0, 50.0),)), pts=1))
        harness.push(frame(Tracks((track(1, 70.0, 60.0, TrackState.COASTING),)), pts=2))
        harness.push(frame(pts=3))
        assert not target.exists()
        harness.drain()
        np.testing.assert_array_equal(cv2.imread(str(target)), kept.data)


def test_the_snapshot_is_written_when_stopped_early(tmp_path: Path) -> None:
    """A pipeline that never sees EOS writes its image, too."""
    target = tmp_path / "shot.jpg"
    with Harness("trackoverlay", snapshot=str(target)) as harness:
        harness.push(frame(Tracks((track(1, 50.0, 40.0),))))
    assert cv2.imread(str(target)).shape == (120, 160, 3)


def test_no_confirmed_track_no_snapshot(tmp_path: Path) -> None:
    """A warning says why there is no file."""
    target = tmp_path / "shot.png"
    with Harness("trackoverlay", snapshot=str(target)) as harness:
        harness.push(frame())
        harness.drain()
        assert any("no frame had a confirmed track" in message.text for message in harness.messages)
    assert not target.exists()


def test_a_snapshot_never_takes_the_place_of_an_input(tmp_path: Path) -> None:
    """Nor of the file of another element."""
    image = tmp_path / "shot.png"
    image.write_bytes(b"a photograph")
    with pytest.raises(DescriptionError, match=r"trackoverlay0 must not write .*: it is read by filesrc0"):
        Pipeline.parse(f"filesrc location={image} ! decode ! trackoverlay snapshot={image} ! fakesink")


def test_a_bad_snapshot_path_fails_at_start(tmp_path: Path) -> None:
    """The pipeline does not run for an hour before it says so."""
    with pytest.raises(StreamkitError, match=r"snapshot: .*does not exist; make it first"):
        Pipeline.parse(f"videotestsrc ! trackoverlay snapshot={tmp_path}/gone/shot.png ! fakesink").run(
            timeout_s=20
        )


def test_it_runs_in_a_pipeline_behind_a_planar_source() -> None:
    """A converter is put before it, and frames without tracks get a status line."""
    with Pipeline.parse(
        "dronetestsrc num-buffers=3 ! video/x-raw, format=I420, width=320, height=240 "
        "! trackoverlay ! appsink name=out"
    ) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    assert [item.caps["format"] for item in frames] == ["BGR"] * 3
    assert frames[2].data[:12].max() > 200
