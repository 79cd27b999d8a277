"""The element, by hand and in real pipelines."""

import dataclasses
import re
from types import ModuleType

import numpy as np
import pytest

from streamkit import (
    Detections,
    Features,
    FeatureSpace,
    Frame,
    Pipeline,
    PropertyError,
    Registration,
    RegistrationStatus,
    Tracks,
    TrackState,
    raw_video_caps,
)
from streamkit.testing import Harness
from streamkit_tracker.element import observe


def frame_of(seen, index: int, **changes) -> Frame:
    """A simulated frame with the metadata that the elements before this one attach."""
    height, width = seen.image.shape
    registration = Registration(
        seen.to_previous,
        seen.to_reference,
        reference=changes.pop("reference", 0),
        reference_change=changes.pop("reference_change", None),
        status=changes.pop("status", RegistrationStatus.OK),
        corner_std=changes.pop("corner_std", 0.1),
    )
    count = len(seen.centroids)
    detections = Detections(seen.centroids, seen.boxes, np.full(count, 300.0), np.ones(count))
    caps = raw_video_caps("GRAY8", width, height)
    frame = Frame(seen.image.copy(), caps, pts=index * 40_000_000, seq=index).replace(**changes)
    return frame.attach(registration, detections)


def flight(scenes: ModuleType, frames: int = 25):
    """One car under a moving camera, every frame of it detected."""
    car = scenes.Car((120, 120), (80, 30), scenes.car_texture(np.random.default_rng(1)))
    return list(scenes.Flight([car], frames=frames, seed=1, miss=0.0, false_alarms=0))


def test_labels_do_not_make_regions_of_motion_objects(scenes: ModuleType) -> None:
    """A recogniser may label what framediff found; only the detector's own word makes them objects."""
    frame = frame_of(flight(scenes, frames=1)[0], 0)
    found = frame.get(Detections)
    assert found is not None
    labelled = frame.attach(dataclasses.replace(found, labels=("car",) * len(found)))
    objects = frame.attach(dataclasses.replace(found, are_objects=True))
    assert not observe(labelled, None).are_objects
    assert observe(objects, None).are_objects


def test_a_frame_in_which_a_detector_finds_nothing_is_not_one_without_a_detector(scenes: ModuleType) -> None:
    """Detections without a row keep their kind, and count as a look at the frame; no Detections do not."""
    frame = frame_of(flight(scenes, frames=1)[0], 0)
    nothing = Detections(np.zeros((0, 2)), np.zeros((0, 4)), np.zeros(0), np.zeros(0), are_objects=True)
    empty = observe(frame.attach(nothing), None)
    assert empty.are_objects
    assert empty.detector_ran
    assert not observe(Frame(frame.data, frame.caps), None).detector_ran


def tracks_of(frames: list[Frame]):
    """The tracks of the one frame that came out."""
    (frame,) = frames
    found = frame.get(Tracks)
    assert found is not None
    return found.tracks


def states_of(frames: list[Frame]) -> list[str]:
    """Their states."""
    return [str(track.state) for track in tracks_of(frames)]


def test_detections_become_tracks(scenes: ModuleType):
    """Tentative at first, confirmed once the car has moved, within 3 px, in px/s of the plane."""
    seen = flight(scenes)
    with Harness("particletrack") as harness:
        states = [states_of(harness.push(frame_of(s, i))) for i, s in enumerate(seen[:-1])]
        (track,) = tracks_of(harness.push(frame_of(seen[-1], len(seen) - 1)))
    assert states[0] == ["tentative"]
    assert states[-1] == ["confirmed"]
    assert np.hypot(track.x - seen[-1].truth[0][0], track.y - seen[-1].truth[0][1]) < 3
    np.testing.assert_allclose(track.velocity, (80, 30), atol=8)
    assert track.age_ns == 24 * 40_000_000
    assert 0 <= track.score <= 1
    assert track.covariance.shape == (2, 2)


def test_an_error_of_the_plane_delays_no_target(scenes: ModuleType):
    """All frames may be off by the same: `corner_std` says little about the motion between them."""
    with Harness("particletrack") as harness:
        for index, seen in enumerate(flight(scenes, 10)):
            changes = {"status": RegistrationStatus.WEAK, "corner_std": 40.0}
            states = states_of(harness.push(frame_of(seen, index, **changes)))
    assert states == ["confirmed"]


def test_the_real_time_between_frames_counts(scenes: ModuleType):
    """The same pictures at half the rate are cars at half the speed."""
    with Harness("particletrack") as harness:
        for index, seen in enumerate(flight(scenes)):
            (track,) = tracks_of(harness.push(frame_of(seen, index, pts=index * 80_000_000)))
    np.testing.assert_allclose(track.velocity, (40, 15), atol=5)


def test_frames_missing_in_between_are_bridged_over_the_plane(scenes: ModuleType):
    """When frames were dropped, the way to the last one seen is taken from the reference plane."""
    ids = set()
    with Harness("particletrack", max_speed=800.0) as harness:
        for index, seen in enumerate(flight(scenes, 40)):
            if index % 3 == 0:
                tracks = tracks_of(harness.push(frame_of(seen, index)))
                ids |= {track.id for track in tracks if track.state == TrackState.CONFIRMED}
    (track,) = tracks
    assert ids == {track.id}
    np.testing.assert_allclose(track.velocity, (80, 30), atol=16)  # three standard deviations


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"status": RegistrationStatus.CUT}, "lost"),
        ({"reference": 1}, "lost"),
        ({"reference": 1, "reference_change": np.diag([2.0, 2.0, 1.0])}, "confirmed"),
        ({"status": RegistrationStatus.LOST}, "coasting"),
        ({"status": RegistrationStatus.WEAK}, "confirmed"),
        ({"epoch": 1}, "confirmed"),
    ],
)
def test_what_registration_says_decides(scenes: ModuleType, changes: dict, expected: str):
    """A cut or an unknown plane ends the track; a mapped plane keeps it; a lost frame lets it coast."""
    seen = flight(scenes, 20)
    with Harness("particletrack") as harness:
        for index in range(19):
            harness.push(frame_of(seen[index], index))
        states = states_of(harness.push(frame_of(seen[19], 19, **changes)))
    assert states[0] == expected


def test_a_new_epoch_without_registration_ends_the_tracks(scenes: ModuleType):
    """After a reconnect the direction of the camera is unknown."""
    sequence = [image for image, _ in scenes.TurningScene(frames=4)]
    caps = raw_video_caps("GRAY8", 360, 270)
    with Harness("particletrack", window="150,100,48,34") as harness:
        for index, image in enumerate(sequence[:3]):
            harness.push(Frame(image, caps, seq=index))
        elsewhere = np.zeros_like(sequence[3])
        assert states_of(harness.push(Frame(elsewhere, caps, seq=3, epoch=1))) == ["lost"]


def test_a_window_by_hand_is_followed_without_any_metadata(scenes: ModuleType):
    """x,y,w,h,angle: the target is confirmed in the first frame and followed by its appearance."""
    sequence = list(scenes.TurningScene(seed=2, frames=12))
    x, y, length, width, angle = sequence[0][1]
    window = f"{x - (length - 1) / 2},{y - (width - 1) / 2},{length},{width},{angle}"
    caps = raw_video_caps("GRAY8", 360, 270)
    with Harness("particletrack", window=window) as harness:
        for index, (image, truth) in enumerate(sequence):
            (track,) = tracks_of(harness.push(Frame(image, caps, pts=index * 40_000_000, seq=index)))
            assert track.state == TrackState.CONFIRMED
            assert np.hypot(track.x - truth[0], track.y - truth[1]) < 1.0


def test_a_window_set_while_playing_adds_a_target(scenes: ModuleType):
    """The target of the first window goes on; the new one starts in the frame after it was set."""
    (image, first), *_ = scenes.TurningScene(seed=2, frames=1)
    frame = Frame(image, raw_video_caps("GRAY8", 360, 270))
    text = f"{first[0] - first[2] / 2},{first[1] - first[3] / 2},{first[2]},{first[3]}"
    with Harness("particletrack", window=text) as harness:
        assert [track.id for track in tracks_of(harness.push(frame))] == [1]
        harness.element.window = "20,20,40,30"
        tracks = tracks_of(harness.push(frame.replace(seq=1)))
        assert [track.id for track in tracks] == [1, 2]
        assert (tracks[1].x, tracks[1].y) == (39.5, 34.5)
        with pytest.raises(PropertyError, match="property window must be"):
            harness.element.window = "20,20"
        assert harness.element.window == "20,20,40,30"


@pytest.mark.parametrize("window", ["", "1,2,3", "1,2,3,x", "1,2,0,4", "1,2,nan,4", "1,2,3,4,5,6"])
def test_an_unreadable_window_is_refused_at_the_start(window: str):
    """The error names element, property, rule, text and an example."""
    rule = (
        r'particletrack\S*: property window must be "x,y,w,h".* got "' + re.escape(window) + '"; for example'
    )
    with pytest.raises(PropertyError, match=rule):
        Harness("particletrack", window=window)


def test_a_window_outside_the_frame_is_a_warning():
    """The stream goes on without the target."""
    caps = raw_video_caps("GRAY8", 64, 48)
    with Harness("particletrack", window="500,500,10,10") as harness:
        assert tracks_of(harness.push(Frame(np.zeros((48, 64), np.uint8), caps))) == ()
        texts = [str(message) for message in harness.messages]
    assert any("must overlap the 64x48 frame" in text for text in texts)


class PixelSpace:
    """A feature space that is the window itself."""

    patch_size = (12, 12)
    version = 1

    def embed(self, patches: np.ndarray) -> np.ndarray:
        return patches.reshape(len(patches), -1) - patches.mean(axis=(1, 2))[:, None]


def test_windows_compare_in_the_travelling_feature_space(scenes: ModuleType):
    """With compare=features the space that comes with the frames is the appearance."""
    with Harness("particletrack", compare="features") as harness:
        for index, seen in enumerate(flight(scenes)):
            vectors = np.ones((len(seen.centroids), 3), np.float32)
            frame = frame_of(seen, index).attach(Features(vectors)).attach_as(FeatureSpace, PixelSpace())
            (track,) = tracks_of(harness.push(frame))
    assert track.state == TrackState.CONFIRMED
    assert np.hypot(track.x - seen.truth[0][0], track.y - seen.truth[0][1]) < 3


def test_a_missing_feature_space_is_warned_of_once():
    """compare=features without a space warns once and goes on with templates."""
    caps = raw_video_caps("GRAY8", 64, 48)
    with Harness("particletrack", compare="features") as harness:
        for index in range(3):
            harness.push(Frame(np.zeros((48, 64), np.uint8), caps, seq=index))
        warnings = [message for message in harness.messages if "waveleteigen" in str(message)]
    assert len(warnings) == 1


def test_the_frame_itself_is_not_touched(scenes: ModuleType):
    """Pixels, time and other metadata pass on as they are."""
    frame = frame_of(flight(scenes, 1)[0], 0)
    with Harness("particletrack") as harness:
        (out,) = harness.push(frame)
    assert out.data is frame.data
    assert out.pts == frame.pts
    assert out.get(Registration) is frame.get(Registration)


def run_pipeline(description: str) -> list[tuple]:
    """Every track of every frame as plain numbers."""
    with Pipeline.parse(description) as pipeline:
        pipeline.play()
        return [
            (t.id, str(t.state), t.x, t.y, t.length, t.width, t.angle, t.velocity, t.score)
            for frame in pipeline["out"]
            for t in frame.get(Tracks).tracks
        ]


@pytest.mark.parametrize("form", ["GRAY8", "I420"])
def test_a_pipeline_of_pictures_alone_runs(form: str):
    """Without detections and registration a window by hand works in a pipeline, on every luma format."""
    rows = run_pipeline(
        f"videotestsrc num-buffers=4 ! video/x-raw,format={form},width=320,height=240 "
        "! particletrack window=100,80,48,32 ! appsink name=out"
    )
    assert [row[0] for row in rows] == [1] * len(rows)
    assert len(rows) >= 3


def test_the_whole_chain_tracks_cars_and_repeats_itself():
    """Stitch, framediff and particletrack on a synthetic flight: tracks come, twice the same bit for bit."""
    chain = (
        "dronetestsrc num-buffers=45 seed=1 ! video/x-raw,format=GRAY8,width=640,height=360 "
        "! stitch ! framediff ! particletrack seed=5 ! appsink name=out"
    )
    first = run_pipeline(chain)
    assert sum(row[1] == "confirmed" for row in first) > 20
    assert first == run_pipeline(chain)
