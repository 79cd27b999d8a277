"""RecordTally: why no record of a run has a target or a position."""

import dataclasses

import msgspec
import numpy as np
import pytest

from streamkit import (
    TRACKS_CAPS,
    Detections,
    Frame,
    GroundReference,
    Pose,
    RecordTally,
    Track,
    Tracks,
    TrackState,
    raw_video_caps,
    track_record,
)
from streamkit.flow.record import GeoRecord

EMPTY = Frame(np.zeros((2, 4), np.uint8), raw_video_caps("GRAY8", 4, 2), seq=0)
TARGET = Track(7, TrackState.CONFIRMED, 1.0, 1.0, 1.0, 1.0, 0.0, np.zeros(2), np.eye(2), 0.5, 7)
NOTHING_FOUND = Detections(np.zeros((0, 2)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))
SEEN = EMPTY.attach(Tracks((TARGET,)))


@pytest.mark.parametrize(
    ("frames", "positions", "text"),
    [
        ([], False, ""),
        ([EMPTY], False, "none of 1 frames carried tracks; put particletrack before it"),
        ([EMPTY.attach(Tracks())], False, "none carried detections; put framediff before particletrack"),
        ([EMPTY.attach(Tracks()).attach(NOTHING_FOUND)], False, ""),
        ([EMPTY.attach(Tracks()).attach(NOTHING_FOUND)], True, "no target in any of 1 frames, though"),
        ([EMPTY, SEEN], False, ""),
        ([SEEN], True, "none of 1 frames carried a pose; pair telemetry with posesync"),
        ([SEEN.attach(Pose(48.0, 11.0, 600.0))], True, "set ground-altitude"),
        ([Frame(b"{}", TRACKS_CAPS, seq=0)], False, ""),
        (
            [Frame(b"{}", TRACKS_CAPS, seq=0)],
            True,
            "no target in 1 records has a position; pair telemetry with posesync when they are made, and set "
            "ground-altitude there where it does not tell the height above ground",
        ),
    ],
)
def test_reasons(frames: list[Frame], positions: bool, text: str) -> None:
    """The first missing input is named, with the remedy."""
    tally = RecordTally(needs_positions=positions)
    for frame in frames:
        tally.note(frame)
    found = tally.shortfall()
    assert text in found
    assert bool(found) is bool(text)


def test_an_empty_scene_is_remarked() -> None:
    """Frames that were searched in vain are no fault, but they are not silent."""
    tally = RecordTally()
    tally.note(EMPTY.attach(Tracks()).attach(NOTHING_FOUND))
    assert tally.remark() == "no target in any of 1 frames"
    tally.note(EMPTY.attach(Tracks((dataclasses.replace(TARGET, state=TrackState.TENTATIVE),))))
    assert tally.remark() == "no target was confirmed; 1 of 2 frames have tentative ones"
    tally.note(SEEN)
    assert tally.remark() == ""
    tally = RecordTally()
    tally.note(EMPTY.attach(Tracks()))
    assert tally.shortfall()
    assert tally.remark() == "", "the shortfall says why"


def test_one_position_is_no_shortfall() -> None:
    """Without any, what the pose lacks or the states of the targets are the reason."""
    tally = RecordTally(needs_positions=True)
    tally.note(SEEN.attach(Pose(48.0, 11.0, 600.0)), ground_altitude_m=500.0)
    assert "field-of-view" in tally.shortfall()
    tally = RecordTally(needs_positions=True)
    located = GroundReference(np.eye(3), 48.0, 11.0, 3.0, 10.0)
    tally.note(SEEN.attach(Pose(48.0, 11.0, 600.0), located))
    assert "none was confirmed" in tally.shortfall()
    record = track_record(SEEN, source="a", published_ns=None)
    target = msgspec.structs.replace(record.tracks[0], geo=GeoRecord(lat=48.0, lon=11.0))
    tally.note(SEEN, msgspec.structs.replace(record, tracks=(target,)))
    assert tally.shortfall() == ""
