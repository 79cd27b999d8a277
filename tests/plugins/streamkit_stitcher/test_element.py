"""stitch in a harness and in pipelines."""

import math
from dataclasses import dataclass
from fractions import Fraction

import cv2
import numpy as np
import pytest

from streamkit import (
    DescriptionError,
    ElementFailure,
    Frame,
    FrameFlags,
    GroundReference,
    MessageKind,
    Pipeline,
    Pose,
    Registration,
    RegistrationStatus,
    ResourceError,
    raw_video_caps,
)
from streamkit.testing import Harness
from streamkit_video.dronetestsrc.truth import TrueRegistration
from tests.slowness import patience

SMALL = (360, 640)


@dataclass(frozen=True)
class Note:
    """Metadata of an author's own type."""

    text: str


@pytest.fixture(scope="module")
def flight(ground, make_flight):
    """A short flight of small frames."""
    return make_flight(ground, 400, SMALL, cars=4)


def grey(frame, seq=0, **fields):
    """A GRAY8 frame."""
    height, width = frame.shape
    return Frame(frame, raw_video_caps("GRAY8", width, height), seq=seq, **fields)


def push(harness, frame):
    """The one frame that comes out, and its registration."""
    (passed,) = harness.push(frame)
    return passed, passed.get(Registration)


def mosaics(messages):
    """The fields of the mosaic messages."""
    return [
        message.fields
        for message in messages
        if message.kind is MessageKind.ELEMENT and message.fields["name"] == "mosaic"
    ]


def test_frames_pass_untouched_with_registration(flight):
    """The array is the very one that came, and what was attached stays."""
    with Harness("stitch") as harness:
        for index in range(4):
            frame = grey(flight.frame(index), index).attach(Note("first"))
            passed, found = push(harness, frame)
            assert passed.data is frame.data
            assert passed.get(Note) == Note("first")
            assert isinstance(found.status, RegistrationStatus)
        assert flight.error(found.to_reference, 3) < 0.5
        assert found.inliers > 20


@pytest.mark.parametrize("pixel_format", ["I420", "NV12"])
def test_colour_frames_are_registered_by_luma_and_mosaicked_in_colour(flight, pixel_format, tmp_path):
    """Registration uses the luma plane; the mosaic is in colour."""
    location = tmp_path / "m.png"
    data = np.full((540, 640), 90, np.uint8)
    data[:360] = flight.frame(0)
    with Harness("stitch", location=str(location)) as harness:
        _, found = push(harness, Frame(data, raw_video_caps(pixel_format, 640, 360)))
        assert found.keyframe
        harness.drain()
    blue, green, red = cv2.imread(str(location)).reshape(-1, 3).mean(axis=0)
    assert green > max(blue, red) + 10


def test_photographs_of_odd_sizes_keep_their_colours(tmp_path):
    """An odd width or height has no I420; the mosaic is in colour and as precise all the same."""
    random = np.random.default_rng(3)
    ground = cv2.resize(random.integers(0, 255, (90, 120, 3), dtype=np.uint8), (960, 720))
    for number in range(3):
        part = ground[10 : 10 + 451, 40 + 150 * number : 40 + 150 * number + 601]
        cv2.imwrite(str(tmp_path / f"p{number}.png"), part)
    text = (
        f"multifilesrc location={tmp_path}/p%d.png ! decode ! stitch location={tmp_path}/m.png "
        "! appsink name=out"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    assert {frame.caps["format"] for frame in frames} == {"BGR"}
    places = [frame.get(Registration).to_reference[:2, 2] for frame in frames]
    assert places == [pytest.approx([150.0 * number, 0.0], abs=0.2) for number in range(3)]
    mosaic = cv2.imread(str(tmp_path / "m.png"))
    assert mosaic.shape == pytest.approx((451, 901, 3), abs=2)
    found = cv2.matchTemplate(mosaic, ground[20:440, 50:920], cv2.TM_CCOEFF_NORMED)
    assert found.max() > 0.99


def test_corrupt_frames_are_lost_and_ignored(flight):
    """A corrupt frame is skipped; the next good one is registered as if it were absent."""
    with Harness("stitch") as harness:
        for index in range(3):
            push(harness, grey(flight.frame(index), index))
        _, corrupt = push(harness, grey(flight.frame(200), 3, flags=FrameFlags.CORRUPT))
        _, after = push(harness, grey(flight.frame(4), 4))
        assert corrupt.status == RegistrationStatus.LOST
        assert after.status == RegistrationStatus.OK
        assert flight.error(after.to_reference, 4) < 0.5


def test_a_new_epoch_or_size_opens_a_plane(flight):
    """The plane's number goes up, the status is cut and the homography the identity."""
    with Harness("stitch") as harness:
        _, first = push(harness, grey(flight.frame(0)))
        _, second = push(harness, grey(flight.frame(1), 1, epoch=1))
        _, third = push(harness, grey(flight.frame(2)[:300, :600].copy(), 2, epoch=1))
        assert [item.reference for item in (first, second, third)] == [0, 1, 2]
        assert second.status == third.status == RegistrationStatus.CUT
        assert np.array_equal(second.to_reference, np.eye(3))
        assert second.reference_change is None


def test_the_mosaic_is_written_at_eos_and_announced(flight, tmp_path):
    """A message reports path and size; stopping afterwards does not write again."""
    location = tmp_path / "m.png"
    harness = Harness("stitch", location=str(location))
    for index in range(0, 60, 4):
        push(harness, grey(flight.frame(index), index))
    assert not location.exists()
    harness.drain()
    height, width = cv2.imread(str(location), cv2.IMREAD_UNCHANGED).shape
    (message,) = mosaics(harness.messages)
    assert (message["path"], message["width"], message["height"]) == (str(location), width, height)
    location.unlink()
    harness.close()
    assert not location.exists()


def test_the_mosaic_is_written_when_eos_does_not_come(flight, tmp_path):
    """A stopped pipeline leaves the mosaic of what was seen."""
    location = tmp_path / "m.jpg"
    with Harness("stitch", location=str(location)) as harness:
        push(harness, grey(flight.frame(0)))
    assert cv2.imread(str(location)).shape == (360, 640, 3)


def test_a_stop_says_what_became_of_the_mosaic(flight, tmp_path):
    """As at EOS: the file, or why there is none."""
    location = tmp_path / "m.jpg"
    with Harness("stitch", location=str(location)) as harness:
        push(harness, grey(flight.frame(0)))
    assert harness.element.results["files"] == 1
    location.unlink()
    with Harness("stitch", location=str(location)) as harness:
        push(harness, grey(np.zeros(SMALL, np.uint8)))
    (warning,) = [message for message in harness.messages if message.kind is MessageKind.WARNING]
    assert warning.text == f"{location}: no mosaic: none of 1 frames could be registered"


def test_lost_frames_do_not_smear_the_mosaic(flight, tmp_path):
    """Black and corrupt frames leave no trace in it."""
    with Harness("stitch", location=str(tmp_path / "m.png")) as harness:
        push(harness, grey(flight.frame(0)))
        for index in range(8):
            push(harness, grey(np.zeros(SMALL, np.uint8), index))
        push(harness, grey(flight.frame(300), 9, flags=FrameFlags.CORRUPT))
        harness.drain()
    frame = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(frame, flight.frame(0))


def test_no_frames_no_mosaic(tmp_path):
    """Without a usable frame no file is written: a warning says so, for `launch --strict` a failure."""
    location = tmp_path / "m.png"
    with Harness("stitch", location=str(location)) as harness:
        harness.drain()
    (warning,) = [message for message in harness.messages if message.kind is MessageKind.WARNING]
    assert warning.text == f"{location}: no mosaic: no frame came"
    with Harness("stitch", location=str(location)) as harness:
        for index in range(3):
            push(harness, grey(np.zeros(SMALL, np.uint8), index))
        harness.drain()
    (warning,) = [message for message in harness.messages if message.kind is MessageKind.WARNING]
    assert warning.text == f"{location}: no mosaic: none of 3 frames could be registered"
    assert warning.fields["code"] == "shortfall"
    assert list(tmp_path.iterdir()) == []


def test_lost_frames_are_no_shortfall_without_a_mosaic(flight):
    """Where none is asked for, the summary alone counts them."""
    with Harness("stitch") as harness:
        push(harness, grey(np.zeros(SMALL, np.uint8)))
        harness.drain()
    assert not [message for message in harness.messages if message.kind is MessageKind.WARNING]


def test_a_model_gives_the_field_of_view(flight):
    """An oblique camera without one has no position; with its model it has that of the published view."""

    def positions(**properties):
        found = []
        with Harness("stitch", max_geo_error_m=1e6, **properties) as harness:
            for number in range(6):
                angles = (0.0, 0.0, 0.0, (0.0, -math.pi / 4, 0.0))
                pose = Pose(46.8 + 1e-4 * number, -92.1, 100.0, *angles, ground_altitude=0.0)
                passed, _ = push(harness, grey(flight.frame(number), number).attach(pose))
                found.append(passed.get(GroundReference))
        return [None if one is None else one.to_local for one in found]

    model, view = positions(drone="mini-2"), positions(field_of_view=70.5802)
    assert positions() == [None] * 6
    assert model[-1] == pytest.approx(view[-1], rel=1e-4, abs=1e-6)


def test_an_unknown_model_is_refused():
    """The error says what to set instead."""
    with pytest.raises(DescriptionError, match=r"drone=phantom-9: .* set field-of-view"):
        Pipeline.parse("dronetestsrc ! stitch drone=phantom-9 ! fakesink")


@pytest.mark.parametrize("name", ["m.mp4", "file/m.png"])
def test_a_location_that_cannot_be_written_fails_at_start(tmp_path, name):
    """The user learns of it before the flight."""
    (tmp_path / "file").touch()
    with pytest.raises(ResourceError, match="location"):
        Harness("stitch", location=str(tmp_path / name))


def test_a_disk_that_fails_at_eos_is_an_error(flight, tmp_path):
    """At EOS the error names the element and the file; at stop it is a warning."""
    folder = tmp_path / "gone"
    folder.mkdir()
    harness = Harness("stitch", location=str(folder / "m.png"))
    push(harness, grey(flight.frame(0)))
    folder.rmdir()
    folder.touch()
    with pytest.raises(Exception, match="the mosaic is lost"):
        harness.drain()
    harness.close()


def test_a_pipeline_registers_a_drone_to_the_truth(tmp_path):
    """The source knows the exact homographies: the median corner error is far below a pixel."""
    width, height = 960, 540
    corners = np.array([[[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]]], dtype=float)
    text = (
        f"dronetestsrc num-buffers=60 speed=12 ! video/x-raw, format=I420, width={width}, height={height} "
        f"! stitch location={tmp_path}/m.png ! appsink name=out"
    )
    errors, first = [], None
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        for frame in pipeline["out"]:
            found, truth = frame.get(Registration), frame.get(TrueRegistration).to_reference
            first = np.linalg.inv(truth) if first is None else first
            true = cv2.perspectiveTransform(corners, first @ truth)
            measured = cv2.perspectiveTransform(corners, found.to_reference)
            errors.append(np.linalg.norm(true - measured, axis=2).max())
    assert len(errors) == 60
    assert np.median(errors) < 0.3
    assert max(errors) < 1.0
    mosaic = cv2.imread(str(tmp_path / "m.png"))
    assert mosaic.shape[0] * mosaic.shape[1] > 1.2 * width * height


def test_the_example_line_runs():
    """The line that `inspect` shows works as written."""
    Pipeline.parse("dronetestsrc num-buffers=5 ! stitch ! fakesink").run(timeout_s=30)


def test_the_plane_moves_to_the_middle_and_says_so(flight):
    """Each change of the plane is reported: change @ before @ step is `to_reference`."""
    with Harness("stitch", reference="center") as harness:
        before, planes = None, set()
        for index in range(60):
            _, found = push(harness, grey(flight.frame(index), index))
            if before is not None:
                change = np.eye(3) if found.reference_change is None else found.reference_change
                chained = change @ before.to_reference @ found.to_previous
                assert chained / chained[2, 2] == pytest.approx(found.to_reference, abs=1e-6)
                assert found.reference == before.reference or found.reference_change is not None
            before = found
            planes.add(found.reference)
        assert len(planes) > 1


def test_the_mosaic_pad_shows_the_mosaic_as_it_grows():
    """A branch gets frames of the size it asks for, the last at EOS, without a location."""
    text = (
        "dronetestsrc num-buffers=40 speed=20 ! video/x-raw, width=640, height=360 ! stitch name=s "
        "! fakesink  s.mosaic ! queue ! video/x-raw, format=BGR, width=320, height=240 ! appsink name=out"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        shown = list(pipeline["out"])
    assert len(shown) >= 1
    assert shown[-1].data.shape == (240, 320, 3)
    place = shown[-1].get(Registration)
    assert np.isfinite(place.to_reference).all()
    painted = (shown[-1].data.max(axis=2) > 0).mean()
    assert painted > 0.3


def test_the_end_of_the_mosaic_pad_comes_after_the_file(tmp_path):
    """At EOS of the pad the file is complete."""
    text = (
        "dronetestsrc num-buffers=3 ! video/x-raw, width=320, height=240 "
        f"! stitch name=s location={tmp_path}/m.png "
        "! fakesink  s.mosaic ! queue ! appsink name=out"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert len(list(pipeline["out"])) >= 1
        assert (tmp_path / "m.png").exists()


def test_a_mosaic_asks_for_colour(tmp_path):
    """With a mosaic wanted and nothing else said, frames come in colour; without one they come grey."""
    formats = []
    for location in (f"location={tmp_path}/m.png", ""):
        text = f"dronetestsrc num-buffers=2 ! stitch {location} ! appsink name=out"
        with Pipeline.parse(text) as pipeline:
            pipeline.play()
            formats.append({frame.caps["format"] for frame in pipeline["out"]})
    assert formats == [{"I420"}, {"GRAY8"}]
    assert np.ptp(cv2.imread(str(tmp_path / "m.png")).astype(int), axis=2).max() > 20


def test_the_summary_counts_frames_by_status(flight):
    """At EOS: a black frame is lost, the others are registered, all on one plane."""
    caps = raw_video_caps("GRAY8", 640, 360, Fraction(10))
    with Harness("stitch") as harness:
        for index in range(4):
            pixels = np.zeros((360, 640), np.uint8) if index == 3 else flight.frame(index)
            push(harness, Frame(pixels, caps, seq=index))
        harness.drain()
    summary = next(m.fields for m in harness.messages if m.fields.get("name") == "summary")
    assert (summary["frames"], summary["lost"], summary["planes"]) == (4, 1, 1)
    assert summary["ok"] + summary["still"] == 3


def test_the_summary_names_the_mosaic(flight, tmp_path):
    """It comes after the file, whose size it has, and says why there is no position."""
    with Harness("stitch", location=str(tmp_path / "m.png")) as harness:
        for index in range(3):
            push(harness, grey(flight.frame(index), index))
        harness.drain()
    names = [message.fields.get("name") for message in harness.messages]
    assert names.index("summary") > names.index("mosaic")
    mosaic = harness.messages[names.index("mosaic")].fields
    assert (mosaic["placed"] + mosaic["weak"], mosaic["lost"]) == (3, 0)
    summary = harness.messages[names.index("summary")].fields
    height, width = cv2.imread(str(tmp_path / "m.png")).shape[:2]
    assert (summary["file"], summary["width"], summary["height"]) == (str(tmp_path / "m.png"), width, height)
    assert summary["geo_error_m"] is None
    assert summary["geo_refused"].startswith("no current position; posesync before stitch")


def test_a_run_that_fails_counts_its_mosaic(tmp_path):
    """The mosaic of the frames before the failure is written, and the last line of the run names it."""
    text = f"stitch name=s location={tmp_path / 'm.png'} ! identity error-after=4 ! fakesink"
    pipeline = Pipeline.parse(f"dronetestsrc num-buffers=9 ! {text}")
    with pytest.raises(ElementFailure, match="error-after=4"):
        pipeline.run(timeout_s=patience(60))
    assert (tmp_path / "m.png").is_file()
    row = next(row for row in pipeline.statistics() if row.element == "s")
    assert row.results == {"files": 1}


def test_a_mosaic_of_unknown_ending_is_refused_at_once():
    """Before any frame, with the endings that are known."""
    with pytest.raises(
        DescriptionError, match=r"must end in \.png, .*write for example location=mosaic\.png"
    ):
        Pipeline.parse("dronetestsrc ! stitch location=mosaic.xyz ! fakesink")


def test_an_older_mosaic_is_protected(flight, tmp_path):
    """if-exists=fail refuses it before the first frame; continue goes on with the numbers."""
    (tmp_path / "m-3.png").write_bytes(b"old")
    with pytest.raises(ResourceError, match="exists already"):
        Harness("stitch", location=str(tmp_path / "m-3.png"), if_exists="fail").start()
    with Harness("stitch", location=str(tmp_path / "m-%d.png"), if_exists="continue") as harness:
        push(harness, grey(flight.frame(0)))
        harness.drain()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m-3.png", "m-4.png"]
    assert (tmp_path / "m-3.png").read_bytes() == b"old"


def test_a_strip_sets_its_length(flight):
    """The flight plan is posted, and keyframes come at its interval."""
    pytest.importorskip("pyproj")
    caps = raw_video_caps("GRAY8", 640, 360, Fraction(10))
    with Harness("stitch", strip="0,0,0.001,0", altitude=40.0, field_of_view=60.0, speed=15.0) as harness:
        keys = []
        for index in range(16):
            _, found = push(harness, Frame(flight.frame(index), caps, seq=index))
            keys.append(found.keyframe)
    plan = next(m.fields for m in harness.messages if m.fields.get("name") == "flight-plan")
    assert plan["length_m"] == pytest.approx(111.3, abs=0.1)
    interval = round(plan["interval_s"] * 10)
    assert [index for index, key in enumerate(keys) if key] == list(range(0, 16, interval))


@pytest.mark.parametrize(
    ("properties", "reason"),
    [
        ({"strip": "somewhere"}, "strip must be longitude,latitude"),
        ({"strip": "0,0,0.001,0"}, "strip needs altitude, field-of-view and speed above 0"),
    ],
)
def test_a_strip_without_its_camera_is_refused(flight, properties, reason):
    """The error says what is missing."""
    pytest.importorskip("pyproj")
    with pytest.raises(Exception, match=reason), Harness("stitch", **properties) as harness:
        push(harness, grey(flight.frame(0)))
