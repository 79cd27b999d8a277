"""framediff in a harness and in pipelines."""

from fractions import Fraction

import numpy as np
import pytest

from streamkit import (
    Detections,
    Frame,
    FrameFlags,
    Pipeline,
    PropertyError,
    Registration,
    RegistrationStatus,
    luma,
    raw_video_caps,
)
from streamkit.element.registry import make_element
from streamkit.testing import Harness


def frame_of(world, time, **registration):
    """A frame of a world as it comes from a stitcher."""
    picture = world.frames[time]
    height, width = picture.shape
    frame = Frame(picture, raw_video_caps("GRAY8", width, height), seq=time)
    if not world.is_moving:
        return frame
    fields = {"to_previous": world.to_previous(time), "to_reference": world.to_reference(time)} | registration
    return frame.attach(Registration(**fields))


def found(harness, frame):
    """What the element detects in a frame, which comes after its mask."""
    passed = harness.push(frame)[-1]
    return passed.get(Detections)


def test_the_same_frame_passes_with_detections(world):
    """The image is not copied, what was attached stays, and every frame has Detections."""
    with Harness("framediff") as harness:
        for time in range(3):
            frame = frame_of(world(11, True), time)
            passed = harness.push(frame)[-1]
            assert passed.data is frame.data
            assert passed.seq == time
            assert passed.get(Registration) is frame.get(Registration)
            assert passed.get(Detections).centroids.shape[1] == 2
            assert passed.get(Detections).boxes.shape[1] == 4


@pytest.mark.parametrize("is_moving", [False, True])
def test_detections_sit_on_the_cars(world, is_moving):
    """With registration for a moving camera, without any for a fixed one, once the first ghosts went."""
    scene, near, count = world(12, is_moving), 0, 0
    with Harness("framediff") as harness:
        for time in range(52):
            detections = found(harness, frame_of(scene, time))
            assert len(detections.areas) == len(detections.scores) == len(detections)
            if time >= 37:
                middles = [outline.mean(axis=0) for outline in scene.outlines(time)]
                count += len(detections)
                near += sum(
                    min(np.linalg.norm(centre - middle) for middle in middles) < 15
                    for centre in detections.centroids
                )
    assert count > 30
    assert near / count > 0.95


def warm_up(world, harness):
    """Sends frames until cars are detected."""
    for time in range(30):
        detections = found(harness, frame_of(world(11, True), time))
    assert len(detections) > 0


def test_a_lost_frame_gets_no_detections_and_teaches_nothing(world):
    """The model is held: detections are there again on the first frame that is placed."""
    scene = world(11, True)
    with Harness("framediff") as harness:
        warm_up(world, harness)
        for time in range(30, 33):
            lost = frame_of(scene, time, to_reference=np.eye(3), status=RegistrationStatus.LOST)
            assert len(found(harness, lost)) == 0
        assert len(found(harness, frame_of(scene, 33))) > 0


def test_what_is_set_while_playing_holds_from_the_next_frame_on(world):
    """An area that no car has, and back again."""
    scene = world(11, True)
    with Harness("framediff") as harness:
        warm_up(world, harness)
        harness.element.set_property("min-area", 100000)
        assert len(found(harness, frame_of(scene, 30))) == 0
        harness.element.set_property("min-area", 3)
        assert len(found(harness, frame_of(scene, 31))) > 0


def test_an_object_that_stopped_is_reported_until_it_is_background():
    """A car that drives up and stays is labelled `moving`, then `stopped`; by default it is gone."""
    labels = {}
    for stopped in (False, True):
        with Harness("framediff", stopped=stopped, absorb_frames=40) as harness:
            reported = []
            for time in range(150):
                image = np.full((120, 160), 90, np.uint8)
                left = min(4 * max(time - 50, 0), 80)
                if left:
                    image[50:70, left : left + 30] = 200
                frame = Frame(image, raw_video_caps("GRAY8", 160, 120), seq=time)
                detections = found(harness, frame)
                reported.append(detections.labels if stopped else ("",) * len(detections))
            labels[stopped] = reported
    assert labels[True][69] == ("moving",)
    assert labels[True][100] == ("stopped",)
    assert labels[False][69] == ("",)
    assert labels[False][100] == labels[False][149] == labels[True][149] == ()


def test_a_corrupt_frame_gets_no_detections(world):
    """A damaged image is not compared with anything."""
    scene = world(11, True)
    with Harness("framediff") as harness:
        warm_up(world, harness)
        corrupt = frame_of(scene, 30).replace(
            data=np.full_like(scene.frames[30], 90), flags=FrameFlags.CORRUPT
        )
        assert len(found(harness, corrupt)) == 0
        assert len(found(harness, frame_of(scene, 31))) > 0


@pytest.mark.parametrize(
    "change", [{"status": RegistrationStatus.CUT}, {"reference": 1}], ids=["cut", "new-plane"]
)
def test_a_cut_or_a_new_plane_begins_anew(world, change):
    """Nothing of the old scene is compared with the new one."""
    scene = world(11, True)
    with Harness("framediff") as harness:
        warm_up(world, harness)
        assert len(found(harness, frame_of(scene, 30, **change))) == 0
        reference = change.get("reference", 0)
        assert len(found(harness, frame_of(scene, 31, reference=reference))) == 0
        events = [m.fields["event"] for m in harness.messages if "event" in m.fields]
        assert events == ["new", "new"]


def test_a_change_of_plane_keeps_the_model(world):
    """With reference_change the detections go on without a gap."""
    scene = world(11, True)
    change = np.array([[0.9, -0.3, 40.0], [0.3, 0.9, -7.0], [0, 0, 1.0]])
    with Harness("framediff") as harness:
        warm_up(world, harness)
        moved = {"to_reference": change @ scene.to_reference(30), "reference": 1, "reference_change": change}
        assert len(found(harness, frame_of(scene, 30, **moved))) > 0
        after = {"to_reference": change @ scene.to_reference(31), "reference": 1}
        assert len(found(harness, frame_of(scene, 31, **after))) > 0


def test_frames_dropped_upstream_do_no_harm(world):
    """to_reference places a frame after a gap."""
    scene = world(11, True)
    with Harness("framediff") as harness:
        warm_up(world, harness)
        detections = found(harness, frame_of(scene, 36))
        middles = [outline.mean(axis=0) for outline in scene.outlines(36)]
        assert len(detections) > 0
        for centre in detections.centroids:
            assert min(np.linalg.norm(centre - middle) for middle in middles) < 15


def test_another_size_in_mid_stream(world):
    """New caps begin a new model; frames still pass."""
    scene = world(12, False)
    with Harness("framediff") as harness:
        for time in range(20):
            harness.push(frame_of(scene, time))
        small = np.ascontiguousarray(scene.frames[20][:100, :120])
        detections = found(harness, Frame(small, raw_video_caps("GRAY8", 120, 100), seq=20))
        assert len(detections) == 0


def test_too_many_objects_are_reported_once(world):
    """Beyond max-objects the largest are kept, and one warning says so."""
    with Harness("framediff", max_objects=1) as harness:
        for time in range(30):
            detections = found(harness, frame_of(world(11, True), time))
        assert len(detections) == 1
        warnings = [m for m in harness.messages if str(m.kind) == "warning"]
        assert len(warnings) == 1
        assert "max-objects=1" in str(warnings[0])


def test_a_working_scale_of_three_is_refused():
    """Only halvings keep the cost of reducing low; the error names the property and the remedy."""
    with pytest.raises(
        PropertyError, match=r"framediff\w*: property working-scale must be 0, 1, 2 or 4, got 3; use 0 .*"
    ):
        Harness("framediff", working_scale=3)


def test_former_names_of_properties_are_accepted_with_a_warning():
    """Symbols of the paper; the warning says the name of today."""
    former = {
        "tau": ("frame_interval", 5),
        "ts": ("change_threshold", 20.0),
        "tf": ("foreground_threshold", 9.0),
        "alpha": ("learning_rate", 0.2),
        "weak": ("hysteresis_ratio", 0.4),
        "absorb": ("absorb_frames", 30),
    }
    element, messages = make_element("framediff"), []
    element.poster = messages.append
    for old, (name, value) in former.items():
        element.set_property(old, value)
        assert getattr(element, name) == value
        assert getattr(element.settings.background, name) == value
        assert f"property {old} is called {name.replace('_', '-')} now" in str(messages.pop())
        assert not messages


def test_a_description_may_use_a_former_name():
    """The graph warns and shows the property by its name of today."""
    pipeline = Pipeline.parse("videotestsrc ! framediff name=f tau=2 ! fakesink")
    assert pipeline["f"].properties_set() == {"frame-interval": 2}
    assert (
        "renamed-property",
        "f: tau is called frame-interval now; use that name",
    ) in pipeline.graph.warnings


def test_masks_have_the_frames_size_rate_and_times():
    """Each mask comes before its frame."""
    text = (
        "videotestsrc num-buffers=3 ! video/x-raw, width=161, height=121, framerate=10/1"
        " ! framediff name=d working-scale=2 ! fakesink  d.mask ! appsink name=out"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        masks = list(pipeline["out"])
    assert [mask.pts for mask in masks] == [0, 100_000_000, 200_000_000]
    assert masks[0].data.shape == (121, 161)
    assert masks[0].caps == raw_video_caps("GRAY8", 161, 121, Fraction(10))
    assert masks[0].get(Detections) is not None


@pytest.mark.parametrize("pixel_format", ["GRAY8", "I420", "NV12"])
def test_a_pipeline_passes_every_frame(pixel_format):
    """In a real pipeline, in each format it takes, frames come out with Detections."""
    text = (
        f"videotestsrc num-buffers=6 ! video/x-raw, format={pixel_format}, width=160, height=120"
        " ! framediff working-scale=1 quiet-frames=2 ! appsink name=out"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    assert len(frames) == 6
    assert all(frame.get(Detections) is not None for frame in frames)
    assert luma(frames[0]).shape == (120, 160)


def test_a_flight_begins_without_detections_on_provisional_ground() -> None:
    """Cars of the first frames would leave ghosts; those of ground that is known by then are there."""
    flight = "dronetestsrc num-buffers=40 seed=201 speed=8"
    with Pipeline.parse(f"{flight} ! stitch ! framediff ! appsink name=out max-buffers=100") as pipeline:
        pipeline.play()
        found = [frame.get(Detections) for frame in pipeline["out"]]
    counts = [0 if detections is None else len(detections) for detections in found]
    assert max(counts[:8]) == 0
    assert min(counts[-5:]) > 5
