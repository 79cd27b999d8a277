"""Fuzz of telemetry through telemetryparse, posesync, filesrc and doctor: good checksums, hostile values.

A violation is an exception that is not documented, a case of more than 5 s, a descriptor that stays open,
memory that keeps growing, a number that is not finite, or a frame that is lost.

Run it:  python benchmarks/fuzz_telemetry.py [--minutes 10]
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import fuzz_watch
from hostile_telemetry import klv_stream, pieces, subtitles

from streamkit import Caps, ElementFailure, Frame, Pipeline, Pose, StreamkitError, raw_video_caps
from streamkit.testing import Harness
from streamkit_media.doctor.examine import examine

LIMIT_S = 5.0
SETTLED = 1000  # every decoder has been opened by then
KLV, TEXT, VIDEO = (
    Caps("meta/x-klv, parsed=(boolean)false"),
    Caps("text/x-raw, format=utf8"),
    raw_video_caps("GRAY8", 4, 2),
)


# What it is fed to.


def telemetry_frames(chance: random.Random) -> list[Frame]:
    """Frames of KLV or of subtitles."""
    if chance.random() < 0.3:
        texts = subtitles(chance).split("\n\n")
        return [Frame(text.encode("utf-8", "replace"), TEXT, pts=n * 10**9) for n, text in enumerate(texts)]
    pts = chance.choice((None, 0, 10**9, 1 << 62))
    return [Frame(data, KLV, pts=pts) for data in pieces(klv_stream(chance), chance)]


def no_constant(name: str) -> NoReturn:
    """JSON has no NaN and no infinity."""
    raise AssertionError(f"{name} in JSON")


def through_telemetryparse(chance: random.Random) -> None:
    """Every line is JSON."""
    with Harness("telemetryparse") as harness:
        for frame in telemetry_frames(chance):
            for out in harness.push(frame):
                json.loads(out.data, parse_constant=no_constant)
        harness.drain()


def through_posesync(chance: random.Random) -> None:
    """As many frames come out as went in, and their poses are finite."""
    with Harness("posesync") as harness:
        came, sent = [], 0
        for frame in telemetry_frames(chance):
            came += harness.push(frame, "telemetry")
            came += harness.push(Frame(bytes(8), VIDEO, pts=sent * 40_000_000))
            sent += 1
        check_poses(came + harness.drain(), sent)


def check_poses(frames: list[Frame], sent: int) -> None:
    """The rules of `through_posesync`."""
    assert len(frames) == sent, f"{len(frames)} of {sent} frames"
    for frame in frames:
        if (pose := frame.get(Pose)) is not None:
            assert abs(pose.latitude) <= 90, pose
            assert abs(pose.longitude) <= 180, pose
            values = (pose.altitude, pose.heading, pose.pitch, pose.roll, *(pose.sensor_angles or ()))
            assert all(value is None or math.isfinite(value) for value in values), pose


def telemetry_file(chance: random.Random) -> Path:
    """A file of bare packets or of subtitles."""
    path = Path(chance.choice(("t.klv", "t.SRT", "t.ts")))
    path.write_bytes(
        klv_stream(chance) if chance.random() < 0.5 else subtitles(chance).encode("utf-8", "replace")
    )
    return path


def from_file_to_posesync(chance: random.Random) -> None:
    """The file next to the video."""
    with Harness("posesync", location=str(telemetry_file(chance))) as harness:
        times = [chance.randrange(40 * 10**9) for _ in range(50)]
        came = [out for pts in times for out in harness.push(Frame(bytes(8), VIDEO, pts=pts))]
        check_poses(came + harness.drain(), len(times))


def from_file_to_telemetryparse(chance: random.Random) -> None:
    """The file as a source."""
    Pipeline.parse(f"filesrc location={telemetry_file(chance)} ! telemetryparse ! fakesink").run(
        timeout_s=LIMIT_S
    )


def to_doctor(chance: random.Random) -> None:
    """The file under examination; the report has to be JSON."""
    report = examine(str(telemetry_file(chance)), 1.0, LIMIT_S, "tcp")
    json.loads(json.dumps(report.as_json(), default=str), parse_constant=no_constant)


CASES: tuple[Callable[[random.Random], None], ...] = (
    through_telemetryparse,
    through_posesync,
    from_file_to_posesync,
    from_file_to_telemetryparse,
    to_doctor,
)


def is_documented(error: Exception) -> bool:
    """Whether an error is one for users, and not an unexpected exception of an element."""
    return isinstance(error.cause if isinstance(error, ElementFailure) else error, StreamkitError)


def case(number: int) -> tuple[str, Callable[[], str]]:
    """A case by its number."""
    play = CASES[number % len(CASES)]

    def run() -> str:
        try:
            play(random.Random(number))
        except Exception as error:
            if is_documented(error):
                return f"{play.__name__} refused"
            raise
        return f"{play.__name__} read"

    return play.__name__, run


if __name__ == "__main__":
    fuzz_watch.main(__file__, lambda: case, SETTLED)
