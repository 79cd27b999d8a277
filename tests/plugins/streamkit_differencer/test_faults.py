"""framediff with faulty input: no error, no flood of detections, and the cars are detected again in time."""

from collections.abc import Callable, Iterator

import cv2
import numpy as np
import pytest

from streamkit import Detections, Frame, Registration, RegistrationStatus, raw_video_caps
from streamkit.testing import Harness

QUIET_FRAMES = 12
RECOVERY = QUIET_FRAMES + 2
MAX_OBJECTS = 300
FAULT_BEGINS, FAULT_ENDS = 28, 33
MATCH_PX = 15.0
LOST_FRAMES = 75


def black(picture: np.ndarray, _: np.random.Generator) -> np.ndarray:
    """A lens that is covered."""
    return np.zeros_like(picture)


def brighter(picture: np.ndarray, _: np.random.Generator) -> np.ndarray:
    """An exposure a third longer."""
    return np.clip(1.35 * picture.astype(float), 0, 255).astype(np.uint8)


def noisy(picture: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A rain of white and black pixels and of strong noise."""
    rain = picture + random.normal(0, 35, picture.shape)
    drops = random.random(picture.shape)
    rain[drops < 0.05], rain[drops > 0.95] = 0, 255
    return np.clip(rain, 0, 255).astype(np.uint8)


def elsewhere(picture: np.ndarray, _: np.random.Generator) -> np.ndarray:
    """Another scene for a moment."""
    return np.ascontiguousarray(255 - picture[::-1, ::-1])


def frames_of(
    world, fault: Callable[..., np.ndarray], status: RegistrationStatus | None = None, last: int = FAULT_ENDS
) -> Iterator[Frame]:
    """A world's frames, with a fault in those from FAULT_BEGINS to before `last`, and how they are placed."""
    random = np.random.default_rng(5)
    for time, whole in enumerate(world.frames):
        is_faulty = FAULT_BEGINS <= time < last
        picture = fault(whole, random) if is_faulty else whole
        frame = Frame(picture, raw_video_caps("GRAY8", picture.shape[1], picture.shape[0]), seq=time)
        if world.is_moving:
            placed = Registration(
                to_previous=world.to_previous(time),
                to_reference=world.to_reference(time),
                status=status if is_faulty and status else RegistrationStatus.OK,
            )
            frame = frame.attach(placed)
        yield frame


def watched(frames: Iterator[Frame], **properties: object) -> tuple[list[Detections], list[object]]:
    """The detections of each frame and the messages of the element."""
    with Harness("framediff", **properties) as harness:
        found = [harness.push(frame)[-1].get(Detections) for frame in frames]
        return found, list(harness.messages)


def score(world, found: list[Detections], times: range) -> tuple[float, float]:
    """Shares of the cars that are found, and of the detections that are no car."""
    seen = cars = false = count = 0
    for time in times:
        centroids = found[time].centroids
        near = [outline.mean(axis=0) for outline in world.outlines(time)]
        true = [centre for centre, _ in world.truth(time)]
        cars, count = cars + len(true), count + len(centroids)
        seen += sum(bool((np.linalg.norm(centroids - c, axis=1) < MATCH_PX).any()) for c in true)
        false += sum(min(np.linalg.norm(c - n) for n in near) >= MATCH_PX for c in centroids)
    assert cars > 0
    return seen / cars, false / max(count, 1)


def assert_recovers(world, found: list[Detections], end: int) -> None:
    """No frame has more objects than are allowed, and from lambda + 2 frames on the cars are found again."""
    assert max(len(detections) for detections in found) <= MAX_OBJECTS
    share, false = score(world, found, range(end + RECOVERY, len(found)))
    assert share >= 0.8
    assert false <= 0.15


@pytest.mark.parametrize("fault", [black, brighter, noisy, elsewhere])
@pytest.mark.parametrize("motion", ["auto", "none"])
def test_a_fixed_camera_recovers(world, fault, motion):
    """A black burst, a burst of gain, noise or another scene, with the camera's motion measured or not."""
    scene = world(12, False)
    found, _ = watched(frames_of(scene, fault), motion=motion)
    assert_recovers(scene, found, FAULT_ENDS)


@pytest.mark.parametrize("fault", [black, brighter, noisy, elsewhere])
@pytest.mark.parametrize("status", [None, RegistrationStatus.LOST, RegistrationStatus.WEAK])
def test_a_flying_camera_recovers(world, fault, status):
    """The same where the stitcher says that it is lost, that it is unsure, and where it notices nothing."""
    scene = world(11, True)
    found, _ = watched(frames_of(scene, fault, status))
    assert_recovers(scene, found, FAULT_ENDS)


@pytest.mark.parametrize("is_moving", [False, True], ids=["fixed", "moving"])
def test_a_lasting_gain_step(world, is_moving):
    """The exposure stays: the cars stay found, there is no need to recover."""
    scene = world(12 if not is_moving else 11, is_moving)
    found, messages = watched(frames_of(scene, brighter, last=len(scene.frames)))
    share, false = score(scene, found, range(FAULT_BEGINS, len(found)))
    assert share >= 0.8
    assert false <= 0.15
    assert "gain" in [message.fields.get("event") for message in messages]


def test_a_cut_to_another_scene(world):
    """The new scene is learnt within lambda + 2 frames, and nothing of the old one is compared with it."""
    before, after = world(12, False), world(11, False)
    cut = 20
    frames = [*list(frames_of(before, black, last=0))[:cut], *frames_of(after, black, last=0)]
    renumbered = (frame.replace(seq=number) for number, frame in enumerate(frames))
    found, _ = watched(renumbered, motion="none")
    share, false = score(after, found[cut:], range(RECOVERY, len(after.frames)))
    assert share >= 0.8
    assert false <= 0.15


def test_another_size_and_back(world):
    """Each size is a stream of its own: frames pass, and the cars are found lambda + 2 frames later."""
    scene = world(12, False)

    def smaller(picture: np.ndarray, _: np.random.Generator) -> np.ndarray:
        return cv2.resize(picture, (320, 214), interpolation=cv2.INTER_AREA)

    found, _ = watched(frames_of(scene, smaller))
    assert_recovers(scene, found, FAULT_ENDS)


def test_registration_lost_for_three_seconds(world):
    """Frames without a place get no detections; what is in view again or new is found lambda + 2 later."""
    scene = type(world(11, True))(11, True, count=FAULT_BEGINS + LOST_FRAMES + RECOVERY + 12)
    end = FAULT_BEGINS + LOST_FRAMES
    found, messages = watched(
        frames_of(scene, lambda picture, _: picture, RegistrationStatus.LOST, end), parallax=0.3
    )
    assert not any(len(detections) for detections in found[FAULT_BEGINS:end])
    assert_recovers(scene, found, end)
    events = [message.fields.get("event") for message in messages]
    assert events.index("held") < events.index("resumed")


def test_a_flood_is_capped_and_flagged():
    """Four hundred objects at once: 300 are reported, and a message says how many there were."""
    ground = np.full((480, 640), 120, np.uint8)
    flood = ground.copy()
    for y, x in np.ndindex(20, 20):
        flood[10 + 23 * y : 18 + 23 * y, 10 + 31 * x : 22 + 31 * x] = 230
    caps = raw_video_caps("GRAY8", 640, 480)
    pictures = [ground] * 20 + [flood] + [ground] * 3
    found, messages = watched(Frame(picture, caps, seq=n) for n, picture in enumerate(pictures))
    assert len(found[20]) == MAX_OBJECTS
    (flag,) = [message.fields for message in messages if "found" in message.fields]
    assert flag["found"] == 400
    assert flag["kept"] == MAX_OBJECTS
    assert len(found[21]) == 0


@pytest.mark.parametrize("fault", [black, noisy, elsewhere])
def test_behind_the_stitcher(world, fault):
    """With registrations as the stitcher makes them: it may lose its place, the cars are back."""
    scene = world(11, True)
    found = []
    with Harness("stitch") as stitch, Harness("framediff") as framediff:
        for frame in frames_of(scene, fault):
            unplaced = Frame(frame.data, frame.caps, seq=frame.seq, pts=40_000_000 * frame.seq)
            placed = [f for f in stitch.push(unplaced) if f.get(Registration) is not None][-1]
            found.append(framediff.push(placed)[-1].get(Detections))
    assert_recovers(scene, found, FAULT_ENDS)
