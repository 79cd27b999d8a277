"""How many targets are confirmed in real clips in which few move, most of them from drones.

    STREAMKIT_DATA=... python benchmarks/clutter.py [--lasting-hits 15] [--only TEXT] [--norfair PYTHON]

Each clip of data/sot_video goes through `stitch ! framediff ! particletrack`. The truth has one target, which
is not always the only one: `ids` are those of targets that are shown (confirmed or coasting), `rows` how many
are in a frame, `found` the share of frames in which one overlaps the true target by 0.3. `--norfair` names a
Python with norfair, which gets the same detections.
"""

import argparse

import numpy as np
from many_targets import Sequence, norfair, run
from tracking_sequences import FloatArray, shared_data

from streamkit_tracks.evaluation.readers import read_boxes
from streamkit_tracks.evaluation.scores import Labelled, overlaps

FOUND_OVERLAP = 0.3


def row(name: str, method: str, tracks: list[Labelled], truth: FloatArray) -> tuple[int, float, float]:
    """Prints and returns the figures of one method."""
    ids = {number for tracked in tracks for number in tracked.ids.tolist()}
    rows = sum(len(tracked.ids) for tracked in tracks) / len(tracks)
    seen = [(box, tracked) for box, tracked in zip(truth, tracks, strict=False) if np.isfinite(box).all()]
    found = [(overlaps(box[None], tracked.boxes) > FOUND_OVERLAP).any() for box, tracked in seen]
    figures = len(ids), rows, float(np.mean(found))
    print("| {} | {} | {} | {:.2f} | {:.3f} |".format(name, method, *figures), flush=True)
    return figures


def clip(name: str, lasting_hits: int) -> Sequence:
    """What comes out of the pipeline."""
    path = shared_data() / "sot_video" / name / "video.mp4"
    nothing = Labelled(np.zeros(0, np.int64), np.zeros((0, 4)))
    chain = f"stitch ! framediff ! particletrack lasting-hits={lasting_hits} ! appsink name=out"
    return run(f"filesrc location={path} ! decode ! {chain}", lambda *_: nothing, 10**6)


def main() -> None:
    """Prints the table, and the means of each method."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--lasting-hits", type=int, default=15)
    parser.add_argument("--only", default="")
    parser.add_argument("--norfair", default="")
    options = parser.parse_args()
    figures: dict[str, list[tuple[int, float, float]]] = {}
    print("| clip | tracker | ids | rows | found |\n|---|---|---|---|---|")
    for folder in sorted((shared_data() / "sot_video").iterdir()):
        if options.only not in folder.name:
            continue
        truth = read_boxes(folder / "groundtruth.txt")
        sequence = clip(folder.name, options.lasting_hits)
        methods = {"particletrack": sequence.tracks}
        if options.norfair:
            methods["norfair"] = norfair(options.norfair, sequence)
        for method, tracks in methods.items():
            figures.setdefault(method, []).append(row(folder.name, method, tracks, truth))
    for method, rows in figures.items():
        print("| mean | {} | {:.1f} | {:.2f} | {:.3f} |".format(method, *np.mean(rows, axis=0)))


if __name__ == "__main__":
    main()
