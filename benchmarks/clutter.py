"""How many targets are confirmed in real clips in which few move, most of them from drones.

    STREAMKIT_DATA=... python benchmarks/clutter.py [--lasting-hits 15] [--only TEXT] [--change NAME]
        [--norfair PYTHON]

Each clip of data/sot_video goes through `stitch ! framediff ! particletrack`. The truth has one target, which
is not always the only one: `ids` are those of targets that are shown (confirmed or coasting), `rows` how many
are in a frame, `found` the share of frames in which one overlaps the true target by 0.3; in the row `regions`
a region of motion does. `--norfair` names a Python with norfair, which gets the same detections.
`--change` runs each clip as another camera would have made it (`tracking_changes.py`).
"""

import argparse
import tempfile
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from camera_changes import REPEATABLE, video_frame
from many_targets import Sequence, norfair, run
from tracking_changes import CHANGES
from tracking_sequences import ByteArray, FloatArray, real, shared_data

from streamkit_tracks.evaluation.readers import read_boxes
from streamkit_tracks.evaluation.scores import Labelled, overlaps

FOUND_OVERLAP = 0.3
ENCODER = {"crf": "10", "preset": "veryfast", **REPEATABLE}


def row(name: str, method: str, tracks: list[Labelled], truth: FloatArray) -> tuple[int, float, float]:
    """Prints and returns the figures of one method."""
    ids = {number for tracked in tracks for number in tracked.ids.tolist()}
    rows = sum(len(tracked.ids) for tracked in tracks) / len(tracks)
    figures = len(ids), rows, share_found([tracked.boxes for tracked in tracks], truth)
    print("| {} | {} | {} | {:.2f} | {:.3f} |".format(name, method, *figures), flush=True)
    return figures


def share_found(boxes: list[FloatArray], truth: FloatArray) -> float:
    """Share of the frames with a truth in which one of the boxes left, top, width, height overlaps it."""
    seen = [(box, found) for box, found in zip(truth, boxes, strict=False) if np.isfinite(box).all()]
    return float(np.mean([(overlaps(box[None], found) > FOUND_OVERLAP).any() for box, found in seen]))


def clip(path: Path, lasting_hits: int) -> Sequence:
    """What comes out of the pipeline."""
    nothing = Labelled(np.zeros(0, np.int64), np.zeros((0, 4)))
    chain = f"stitch ! framediff ! particletrack lasting-hits={lasting_hits} ! appsink name=out"
    return run(f"filesrc location={path} ! decode ! {chain}", lambda *_: nothing, 10**6)


def write(pictures: list[ByteArray], copy: Path, step_s: float) -> None:
    """Writes a video of pictures uint8[h, w, 3], BGR, nearly without loss."""
    with av.open(str(copy), "w") as output:
        rate = round(1 / step_s)
        stream = output.add_stream("libx264", rate=rate, options=ENCODER)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.codec_context.thread_count = 1  # the same bytes on every machine
        for index, picture in enumerate(pictures):
            output.mux(stream.encode(video_frame(picture, index, Fraction(1, rate))))
        output.mux(stream.encode())


def clips(only: str, change: str) -> Iterator[tuple[str, Path, FloatArray]]:
    """Names, videos and true boxes, float64[n, 4], of clips with `only` in their names, after a change."""
    with tempfile.TemporaryDirectory() as scratch:
        for folder in sorted((shared_data() / "sot_video").iterdir()):
            if only not in folder.name:
                continue
            video, truth = folder / "video.mp4", read_boxes(folder / "groundtruth.txt")
            if change:
                steps = list(CHANGES[change](real(folder.name)))
                video = Path(scratch) / "changed.mp4"
                truth = np.array([step.box for step in steps]) - [0.5, 0.5, 0, 0]  # of corners
                write([step.picture for step in steps], video, steps[-1].step_s)
            yield folder.name, video, truth


def main() -> None:
    """Prints the table, and the means of each method."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--lasting-hits", type=int, default=15)
    parser.add_argument("--only", default="")
    parser.add_argument("--norfair", default="")
    parser.add_argument("--change", default="", choices=["", *CHANGES])
    options = parser.parse_args()
    figures: dict[str, list[tuple[int, float, float]]] = {}
    print("| clip | tracker | ids | rows | found |\n|---|---|---|---|---|")
    for name, video, truth in clips(options.only, options.change):
        sequence = clip(video, options.lasting_hits)
        methods = {"particletrack": sequence.tracks}
        if options.norfair:
            methods["norfair"] = norfair(options.norfair, sequence)
        boxes = [np.hstack([found[:, :2], found[:, 2:] - found[:, :2]]) for found in sequence.detections]
        print(f"| {name} | regions | | | {share_found(boxes, truth):.3f} |")
        for method, tracks in methods.items():
            figures.setdefault(method, []).append(row(name, method, tracks, truth))
    for method, rows in figures.items():
        print("| mean | {} | {:.1f} | {:.2f} | {:.3f} |".format(method, *np.mean(rows, axis=0)))


if __name__ == "__main__":
    main()
