"""Many targets with identities: MOTA and IDF1 of whole pipelines, against norfair on the same detections.

    STREAMKIT_DATA=... python benchmarks/many_targets.py [--seeds 3] [--first 900] [--frames 300]
        [--norfair PYTHON] [--only cars|pets|traffic]

`cars`: 40 cars of `dronetestsrc` at 1280x720. `pets`: PETS09 S2L1, frames 1 to 69, with its ground truth.
`traffic`: a real drone video without truth; how many cars are followed for 25 frames or more. A match is an
overlap of upright boxes of 0.5. Tracks at the border that match nothing are not counted: there the truth has
no boxes either. Every frame counts from the first one on, though nothing is detected in the first half
second: the background is not known yet; `settled` is MOTA from frame 45 on. `--norfair` names a Python with
norfair and motmetrics; norfair's tracks get the same detections, and motmetrics scores both once more.
"""

import argparse
import json
import subprocess
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tracking_sequences import FloatArray, shared_data

from streamkit import SHOWN_STATES, Detections, Frame, Pipeline, Tracks
from streamkit.geometry.boxes import upright_sides
from streamkit_tracks.evaluation.readers import read_truth
from streamkit_tracks.evaluation.scores import Labelled, overlaps, score_identities
from streamkit_video.dronetestsrc.truth import TrueTargets

CHAIN = "stitch ! framediff ! particletrack ! appsink name=out"
BORDER = 4.0
SETTLED_FRAMES = 45
LONG_LIVED = 25
NORFAIR = """
import json, sys
import numpy as np
from norfair import Detection, Tracker
tracker = Tracker(distance_function="iou", distance_threshold=0.7, hit_counter_max=15, initialization_delay=2)
for line in sys.stdin:
    boxes = json.loads(line)
    found = [Detection(np.array(box).reshape(2, 2)) for box in boxes]
    tracks = [t for t in tracker.update(found)]
    print(json.dumps([[t.id, *map(float, t.estimate.ravel())] for t in tracks if t.id is not None]))
"""


@dataclass
class Sequence:
    """What came out of a pipeline, frame by frame."""

    tracks: list[Labelled] = field(default_factory=list)
    truth: list[Labelled] = field(default_factory=list)
    detections: list[FloatArray] = field(default_factory=list)
    size: tuple[int, int] = (0, 0)
    seconds: float = 0.0


def run(description: str, truth_of: Callable[[Frame, int], Labelled | None], frames: int) -> Sequence:
    """Runs a pipeline; frames without a truth are left out."""
    sequence = Sequence()
    began = time.perf_counter()
    with Pipeline.parse(description) as pipeline:
        pipeline.play()
        for index, frame in enumerate(pipeline["out"]):
            truth = truth_of(frame, index)
            if truth is not None:
                sequence.truth.append(truth)
                sequence.tracks.append(_labelled(frame.get(Tracks)))
                found = frame.get(Detections)
                sequence.detections.append(np.zeros((0, 4)) if found is None else np.asarray(found.boxes))
                sequence.size = (frame.caps.integer("width"), frame.caps.integer("height"))
            if index + 1 >= frames:
                break
    sequence.seconds = time.perf_counter() - began
    return sequence


def true_cars(frame: Frame, _index: int) -> Labelled:
    """The cars of dronetestsrc, as upright boxes."""
    cars = frame.get(TrueTargets)
    assert cars is not None
    return Labelled(
        np.asarray(cars.ids, np.int64),
        _upright(np.column_stack([cars.centres, cars.lengths, cars.widths, cars.angles])),
    )


def norfair(python: str, sequence: Sequence) -> list[Labelled]:
    """Norfair's tracks of the same detections."""
    lines = "\n".join(json.dumps(boxes.tolist()) for boxes in sequence.detections) + "\n"
    done = subprocess.run(
        [python, "-W", "ignore", "-c", NORFAIR], input=lines, check=True, capture_output=True, text=True
    )
    frames = []
    for line in done.stdout.splitlines():
        rows = np.array(json.loads(line), np.float64).reshape(-1, 5)
        boxes = np.column_stack([rows[:, 1:3], rows[:, 3:] - rows[:, 1:3]])
        frames.append(Labelled(rows[:, 0].astype(np.int64), boxes))
    return frames


MOTMETRICS = """
import json, sys
import motmetrics, numpy as np
total = motmetrics.MOTAccumulator(auto_id=True)
for line in sys.stdin:
    true_ids, ids, overlaps = json.loads(line)
    overlaps = np.array(overlaps, float).reshape(len(true_ids), len(ids))
    total.update(true_ids, ids, np.where(overlaps >= 0.5, 1 - overlaps, np.nan))
scores = motmetrics.metrics.create().compute(total, metrics=["mota", "idf1", "num_switches"], name="x")
print(json.dumps({"mota": float(scores.mota["x"]), "idf1": float(scores.idf1["x"]),
                  "switches": int(scores.num_switches["x"])}))
"""


def cross_check(python: str, truth: list[Labelled], tracks: list[Labelled]) -> str:
    """What motmetrics makes of the same boxes, or why it does not."""
    lines = [
        json.dumps([true.ids.tolist(), found.ids.tolist(), overlaps(true.boxes, found.boxes).tolist()])
        for true, found in zip(truth, tracks, strict=True)
    ]
    done = subprocess.run(
        [python, "-W", "ignore", "-c", MOTMETRICS],
        input="\n".join(lines),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        return "motmetrics: " + done.stderr.strip().rpartition("\n")[2]
    return "motmetrics: MOTA {mota:.3f}, IDF1 {idf1:.3f}, {switches} switches".format(
        **json.loads(done.stdout)
    )


def report(
    name: str, method: str, sequence: Sequence, tracks: list[Labelled], milliseconds: float
) -> list[Labelled]:
    """Prints one row; gives the tracks that counted."""
    inner = [
        _without_border(tracked, true, sequence.size)
        for tracked, true in zip(tracks, sequence.truth, strict=True)
    ]
    scores = score_identities(sequence.truth, inner)
    settled = score_identities(sequence.truth[SETTLED_FRAMES:], inner[SETTLED_FRAMES:])
    print(
        f"| {name} | {method} | {scores.mota:.3f} | {scores.idf1:.3f} | {settled.mota:.3f} "
        f"| {scores.switches} | {scores.misses / max(scores.truths, 1):.3f} "
        f"| {scores.false_alarms / max(scores.truths, 1):.3f} | {scores.overlap:.2f} | {milliseconds:.0f} |",
        flush=True,
    )
    return inner


def _without_border(tracked: Labelled, true: Labelled, size: tuple[int, int]) -> Labelled:
    low = tracked.boxes[:, :2] >= BORDER
    high = tracked.boxes[:, :2] + tracked.boxes[:, 2:] <= np.array(size) - BORDER
    matched = np.any(overlaps(tracked.boxes, true.boxes) >= 0.5, axis=1)
    kept = (low & high).all(axis=1) | matched
    return Labelled(tracked.ids[kept], tracked.boxes[kept])


def _labelled(tracks: Tracks | None) -> Labelled:
    shown = [] if tracks is None else [track for track in tracks.tracks if track.state in SHOWN_STATES]
    windows = np.array([[t.x, t.y, t.length, t.width, t.angle] for t in shown]).reshape(-1, 5)
    return Labelled(np.array([track.id for track in shown], np.int64), _upright(windows))


def _upright(windows: FloatArray) -> FloatArray:
    """Upright boxes around windows float64[n, 5]: float64[n, 4], left, top, width, height, px."""
    sides = np.array([upright_sides(*window[2:]) for window in windows]).reshape(-1, 2)
    return np.hstack([windows[:, :2] - sides / 2, sides])


def compare(name: str, sequence: Sequence, frames: int, python: str) -> None:
    """Prints ours, and norfair's where there is one."""
    ours = report(name, "particletrack", sequence, sequence.tracks, sequence.seconds / frames * 1e3)
    if python:
        theirs = report(name, "norfair", sequence, norfair(python, sequence), float("nan"))
        for method, tracks in (("particletrack", ours), ("norfair", theirs)):
            print(f"  {method} by {cross_check(python, sequence.truth, tracks)}", flush=True)


def cars(options: argparse.Namespace) -> None:
    """Synthetic flights."""
    for seed in range(options.first, options.first + options.seeds):
        source = f"dronetestsrc num-buffers={options.frames} cars=40 seed={seed}"
        caps = "video/x-raw,format=GRAY8,width=1280,height=720"
        sequence = run(f"{source} ! {caps} ! {CHAIN}", true_cars, options.frames)
        compare(f"40 cars, seed {seed}", sequence, options.frames, options.norfair)


def pets(options: argparse.Namespace) -> None:
    """People before a fixed camera."""
    folder = shared_data() / "video"
    truth, _ = read_truth(folder / "pets09_s2l1_gt_frames_001-069.txt")
    source = f"filesrc location={folder / 'pets09_s2l1.avi'} ! decode"
    sequence = run(
        f"{source} ! {CHAIN}", lambda _, index: truth[index] if index < len(truth) else None, len(truth)
    )
    compare("PETS09 S2L1 1-69", sequence, len(truth), options.norfair)


def traffic(_options: argparse.Namespace) -> None:
    """Cars seen by a real drone."""
    path: Path = shared_data() / "video" / "drone_nadir_traffic.mp4"
    nothing = Labelled(np.zeros(0, np.int64), np.zeros((0, 4)))
    sequence = run(f"filesrc location={path} ! decode ! {CHAIN}", lambda *_: nothing, 10**6)
    lives = Counter(int(number) for tracked in sequence.tracks for number in tracked.ids)
    long_lived = sum(count >= LONG_LIVED for count in lives.values())
    each = sequence.seconds / max(len(sequence.tracks), 1) * 1e3
    print(
        f"traffic: {long_lived} of {len(lives)} tracks for {LONG_LIVED} frames or more; {each:.0f} ms a frame"
    )


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=900)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--norfair", default="")
    parser.add_argument("--only", default="", choices=["", "cars", "pets", "traffic"])
    options = parser.parse_args()
    print("| sequence | tracker | MOTA | IDF1 | settled | switches | missed | false | overlap | ms a frame |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for part in (cars, pets, traffic):
        if options.only in ("", part.__name__):
            part(options)


if __name__ == "__main__":
    main()
