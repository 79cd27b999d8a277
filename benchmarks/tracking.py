"""One target from a window: success, precision, false confirmations and time, against OpenCV's trackers.

    STREAMKIT_DATA=... python benchmarks/tracking.py [--seeds 1] [--sequences 6] [--first 500]
        [--peers FOLDER] [--only TEXT] [--frames 9999] [--grey] [--change NAME]
        [--set SETTING=NUMBER]

Real sequences (data/sot and data/sot_video) run once for each seed of ours; rendered ones once for each of
`--sequences`. The real ones are dealt into five folds by name: choose a setting by four of them, and judge it
by the fifth. `elsewhere` is the share of the frames reported as confirmed that do not overlap the truth,
`confirmed` the share of the frames that overlap it which are reported as confirmed; a peer confirms all of
its boxes. `--peers` names a folder that `tracking_peers.py` has filled. `--change` runs the real
sequences alone, as another camera or another hand would have made them (`tracking_changes.py`); `--frames`
counts those before the change. One thread.
"""

import argparse
import dataclasses
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tracking_changes import CHANGES, changed_sequences
from tracking_sequences import (
    GONE_FROM,
    KINDS,
    FloatArray,
    Scores,
    Step,
    planes,
    real_names,
    rendered,
    returns,
    score,
    upright,
)

from streamkit.geometry.track import Track, TrackState
from streamkit_tracker.observation import Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.tracker import MultiTargetTracker
from streamkit_tracker.window_geometry import half_turn

LOST_WITHIN = 5
FOLDS = 5
PEERS = ("CSRT", "KCF", "MIL")
MEASURES = ("success", "precision", "elsewhere", "confirmed", "milliseconds", "angle")


class Run:
    """One pass of our tracker over a sequence."""

    def __init__(self, steps: Iterator[Step], settings: TrackerSettings, *, grey: bool = False) -> None:
        tracker = MultiTargetTracker(settings)
        found, truth, hidden, turns, spent = [], [], [], [], []
        self.states: list[TrackState] = []
        for index, step in enumerate(steps):
            levels, chroma = planes(step.picture)
            observation = Observation(
                step.step_s, to_previous=step.to_previous, chroma=None if grey else chroma
            )
            began = time.thread_time()
            if index == 0:
                reports: tuple[Track, ...] = (tracker.start_target(levels, _first(step), observation),)
            else:
                reports = tracker.step(levels, observation)
                spent.append(time.thread_time() - began)
            truth.append(step.box)
            hidden.append(step.hidden)
            self.states.append(reports[0].state if reports else TrackState.LOST)
            window = np.array(reports[0].turned_box) if reports else np.full(5, np.nan)
            found.append(upright(window))
            if step.window is not None:
                turns.append(abs(float(half_turn(window[4] - step.window[4]))))
        claimed = np.array([state is TrackState.CONFIRMED for state in self.states])
        self.milliseconds = 1e3 * float(np.mean(spent))
        self.angle = float(np.degrees(np.nanmedian(turns))) if turns else float("nan")
        self.scores: Scores = score(np.array(found), np.array(truth), claimed)
        self.returns = returns(np.array(found), np.array(truth), claimed, np.array(hidden))

    @property
    def row(self) -> list[float]:
        """The numbers of `MEASURES`."""
        scores = self.scores
        return [*_shown(scores), self.milliseconds, self.angle]


def _first(step: Step) -> FloatArray:
    if step.window is not None:
        return step.window
    x, y, width, height = step.box
    return np.array([x + (width - 1) / 2, y + (height - 1) / 2, width, height, 0.0])


def _shown(scores: Scores) -> list[float]:
    return [scores.success, scores.precision, scores.elsewhere, scores.confirmed]


def peer(path: Path, frames: int) -> list[float]:
    """The same of a peer's boxes."""
    with np.load(path) as file:
        scores = score(file["found"][:frames], file["truth"][:frames])
        spent = float(file["milliseconds"])
    return [*_shown(scores), spent, float("nan")]


def removed(seeds: range, settings: TrackerSettings) -> None:
    """Prints how soon a target that is gone is not reported as confirmed, and how often one that is there."""
    soon, false, frames = 0, 0, 0
    for seed in seeds:
        confirmed = [
            state is TrackState.CONFIRMED for state in Run(rendered("removed", seed), settings).states
        ]
        soon += not any(confirmed[GONE_FROM + LOST_WITHIN :])
        false += confirmed[:GONE_FROM].count(False)
        frames += GONE_FROM
    print(
        f"removed: unseen within {LOST_WITHIN} frames and for good in {soon} of {len(seeds)}; "
        f"falsely unseen in {100 * false / frames:.2f} % of frames",
        flush=True,
    )


def table(
    chosen: list[tuple[str, Callable[[], Iterator[Step]]]],
    settings: TrackerSettings,
    options: argparse.Namespace,
) -> dict[str, dict[str, FloatArray]]:
    """Runs all sequences and prints a row for each: numbers of `MEASURES` by tracker, then by sequence."""
    rows: dict[str, dict[str, FloatArray]] = {"particletrack": {}}
    waits: list[float] = []
    print("| sequence | tracker | " + " | ".join(MEASURES) + " |\n|---" + "|---" * (len(MEASURES) + 1) + "|")
    for label, make in chosen:
        seeds = range(options.seeds if label in real_names() else 1)
        runs = [Run(make(), dataclasses.replace(settings, seed=seed), grey=options.grey) for seed in seeds]
        waits += [frames for run in runs for frames in run.returns]
        rows["particletrack"][label] = np.mean([run.row for run in runs], axis=0)
        for name in PEERS:
            path = Path(options.peers) / name / f"{label}.npz"
            if options.peers and path.exists():
                rows.setdefault(name, {})[label] = np.array(peer(path, options.frames))
        for name, found in rows.items():
            if label in found:
                print(f"| {label} | {name} | " + _numbers(found[label]), flush=True)
        if len(runs) > 1:
            print(
                f"| {label} | spread of the seeds | " + _numbers(np.std([run.row for run in runs], axis=0)),
                flush=True,
            )
    if waits:
        print(
            f"return: confirmed again after a median of {np.median(waits):g} frames in {len(waits)} returns; "
            f"never in {np.isinf(waits).sum()}"
        )
    return rows


def _numbers(values: FloatArray) -> str:
    return " | ".join(f"{value:.3f}" for value in values) + " |"


def summary(rows: dict[str, dict[str, FloatArray]]) -> None:
    """Prints the means over the real sequences, by fold and all, and over each kind of rendered ones."""
    real = [name for name in real_names() if name in rows["particletrack"]]
    groups = {f"fold {fold + 1}": real[fold::FOLDS] for fold in range(FOLDS)} | {"all real": real}
    groups |= {kind: [label for label in rows["particletrack"] if label.startswith(kind)] for kind in KINDS}
    for group, labels in groups.items():
        for name, found in rows.items():
            held = [label for label in labels if label in found]
            if held:
                mean = np.mean([found[label] for label in held], axis=0)
                ahead = np.mean([rows["particletrack"][label][0] > found[label][0] for label in held])
                print(f"| {group} | {name} | {_numbers(mean)} particletrack ahead in {ahead:.2f} |")


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--sequences", type=int, default=6)
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--peers", default="")
    parser.add_argument("--only", default="", help="sequences whose name has this in it")
    parser.add_argument("--frames", type=int, default=9999)
    parser.add_argument("--grey", action="store_true", help="withhold the colour")
    parser.add_argument("--change", default="", choices=["", *CHANGES])
    parser.add_argument("--set", action="append", default=[], metavar="SETTING=NUMBER")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    changes: dict[str, Any] = {
        name: float(number) for name, number in (text.split("=") for text in options.set)
    }
    settings = dataclasses.replace(TrackerSettings(auto_start=False), **changes)
    seeds = range(options.first, options.first + options.sequences)
    kept = changed_sequences(seeds, options.change, options.frames)
    chosen = [each for each in kept if options.only in each[0]]
    summary(table(chosen, settings, options))
    if options.only in "removed" and not options.change:
        removed(range(options.first, options.first + 10), settings)


if __name__ == "__main__":
    main()
