"""Change detection on real sequences by the rules of changedetection.net: framediff, MOG2 and KNN.

Every sequence of a folder as it is, and shaken like a camera on a mast; the same frames for all. Every frame
with a truth inside the sequence's temporal region is scored. In the truth 50 is background; 85, 170 and what
lies outside the region of interest are left out. framediff has its defaults and grey frames. Of each peer the
best of eight settings per sequence stands in the table: grey or colour, with or without shadows, raw or with
a 5 x 5 median; their figures are computed once and kept in a file. Besides F the table lists what happened to
framediff's model. `--variant` changes the sequences as another camera would, see `change_variants.py`; at the
end the sequences stand by the ratio of framediff's F to the better peer's, the worst first.

    STREAMKIT_DATA=... python benchmarks/change_detection.py [sequence ...] [--still] [--variant noise-4 h264]
        [--set noise-gain=3]
"""

from __future__ import annotations

import itertools
import json
import tempfile
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
from change_sequences import MOVING, SHARED, Score, Sequence
from change_variants import CHANGES, changed

from streamkit import Frame, raw_video_caps
from streamkit.testing import Harness

KEPT = Path(tempfile.gettempdir()) / f"streamkit-change-detection-peers-{cv2.__version__}.json"
AS_IT_IS, SHAKEN = "as it is", "shaken"
PEERS = {"MOG2": cv2.createBackgroundSubtractorMOG2, "KNN": cv2.createBackgroundSubtractorKNN}


def own(sequence: Sequence, settings: dict[str, str]) -> tuple[Score, Counter[str], float]:
    """framediff: its score, the events of its model, and ms per frame."""
    height, width = sequence.region.shape
    caps, score, events, spent = raw_video_caps("GRAY8", width, height), Score(), Counter[str](), []
    with Harness("framediff", **settings) as framediff:
        for number, (frame, truth) in enumerate(zip(sequence.frames, sequence.truths, strict=True)):
            grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
            begin = time.process_time()
            mask, _ = framediff.push(Frame(grey, caps, seq=number, pts=number * 40_000_000))
            spent.append(time.process_time() - begin)
            if truth is not None:
                score.add(mask.data, truth, sequence.region)
        events.update(
            str(message.fields["event"]) for message in framediff.messages if message.text == "model"
        )
    return score, events, 1e3 * float(np.median(spent))


def peer(sequence: Sequence, name: str) -> dict[str, float]:
    """F of a peer on a sequence with each of its settings."""
    scores: dict[str, Score] = {}
    for shadows, colour in itertools.product((True, False), repeat=2):
        subtractor = PEERS[name](detectShadows=shadows)
        words = " ".join(("colour" if colour else "grey", *(["shadows"] if shadows else [])))
        for frame, truth in zip(sequence.frames, sequence.truths, strict=True):
            mask = subtractor.apply(frame if colour else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))
            if truth is not None:
                raw = np.where(mask == MOVING, np.uint8(MOVING), np.uint8(0))
                scores.setdefault(words, Score()).add(raw, truth, sequence.region)
                scores.setdefault(f"{words} median", Score()).add(
                    cv2.medianBlur(raw, 5), truth, sequence.region
                )
    return {words: score.f_measure for words, score in scores.items()}


def peers(sequence: Sequence) -> list[float]:
    """The best F of each peer, of its grey settings and of all, from the file of those that are known."""
    known = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    if sequence.name not in known:
        known[sequence.name] = {name: peer(sequence, name) for name in PEERS}
        KEPT.write_text(json.dumps(known, indent=1))
    scores = known[sequence.name]
    return [
        max(value for words, value in scores[name].items() if words.startswith(start))
        for name in PEERS
        for start in ("grey", "")
    ]


def summary(name: str, table: np.ndarray) -> None:
    """Prints the means of a table of F, float64[sequences, framediff and peers]."""
    ours, best = table[:, 0], table[:, 1:].max(axis=1)
    print(
        f"{'mean, ' + name:28} {ours.mean():6.3f} {'':11}",
        *(f"{mean:9.3f}" for mean in table[:, 1:].mean(axis=0)),
        f" ahead of both in {np.count_nonzero(ours > best)} of {len(ours)}, below .8 of the better: "
        f"{np.count_nonzero(ours < 0.8 * best)}",
        flush=True,
    )


def main(names: list[str], variants: list[str], settings: dict[str, str]) -> None:
    """Prints a table for each variant, with its summary, and the ratios to the better peer."""
    cv2.setNumThreads(1)
    columns = [f"{name}{kind}" for name in PEERS for kind in (" grey", "")]
    print(
        f"{'sequence':28} {'F':>6} {'prec':>5} {'rec':>5}",
        *(f"{name:>9}" for name in columns),
        "   ms  events",
    )
    ratios: list[tuple[float, str]] = []
    for variant in variants:
        table: list[list[float]] = []
        for name in names or sorted(path.name for path in SHARED.iterdir()):
            sequence = Sequence.read(SHARED / name)
            if variant != AS_IT_IS:
                sequence = sequence.shaken() if variant == SHAKEN else changed(sequence, variant)
            score, events, ms = own(sequence, settings)
            table.append([score.f_measure, *peers(sequence)])
            if max(table[-1][1:]) > 0:
                ratios.append((score.f_measure / max(table[-1][1:]), sequence.name))
            print(
                f"{sequence.name:28} {score.f_measure:6.3f} {score.precision:5.2f} {score.recall:5.2f}",
                *(f"{value:9.3f}" for value in table[-1][1:]),
                f"{ms:5.1f} ",
                *(f"{event}={count}" for event, count in sorted(events.items())),
                flush=True,
            )
        summary(variant, np.array(table))
    if set(variants) & set(CHANGES):
        rows = (f"{ratio:7.3f} {name}" for ratio, name in sorted(ratios))
        print("ratio to the better peer:", *rows, sep="\n")


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("sequence", nargs="*", help="names of folders; all if there is none")
    parser.add_argument("--still", action="store_true", help="leaves out the shaken ones")
    parser.add_argument(
        "--variant", nargs="+", choices=[*CHANGES, "all"], help="of the sequences, in place of the two"
    )
    parser.add_argument("--set", action="append", default=[], metavar="PROPERTY=VALUE", help="of framediff")
    arguments = parser.parse_args()
    variants = arguments.variant or ([AS_IT_IS] if arguments.still else [AS_IT_IS, SHAKEN])
    settings = dict(text.split("=", 1) for text in arguments.set)
    main(arguments.sequence, list(CHANGES) if "all" in variants else variants, settings)
