"""Tracks of public detections on real truth (MOT Challenge), against SORT, ByteTrack and norfair.

    STREAMKIT_DATA=... python benchmarks/public_detections.py [--peers PYTHON]

Every tracker gets the same det.txt, without its lowest 0, 25 or 50 % of scores; boxes and ids are scored by
`streamkit trackeval`'s own functions. `--peers` names a Python with norfair and roboflow's trackers, each at
its defaults; ByteTrack, which wants scores of 0 to 1, gets them scaled as `detectionsrc` scales them.
The videos are stamped 25 frames a second; ours gets copies with the rate that the peers get.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import av
import numpy as np
from tracking_sequences import shared_data

from streamkit import Pipeline
from streamkit_differencer.detectionsrc import read_detections
from streamkit_tracks.evaluation.command import score_files

SEQUENCES = {"TUD-Stadtmitte": (179, 25), "KITTI-17": (145, 10), "MOT16-09": (525, 30)}
QUANTILES = (0.0, 0.25, 0.5)
FIGURES = ("hota", "idf1", "mota", "switches")
PEERS = """
import json, sys
import numpy as np, supervision
from norfair import Detection, Tracker
from trackers import ByteTrackTracker, SORTTracker
name, rate, frames = json.load(sys.stdin)
tracker = {
    "SORT": lambda: SORTTracker(frame_rate=rate),
    "ByteTrack": lambda: ByteTrackTracker(frame_rate=rate),
    "norfair": lambda: Tracker("iou", 0.7, hit_counter_max=15, initialization_delay=2),
}[name]()
for number, (boxes, scores) in enumerate(frames, 1):
    boxes = np.array(boxes, float).reshape(-1, 4)
    if name == "norfair":
        found = tracker.update([Detection(box.reshape(2, 2)) for box in boxes])
        rows = [(one.id, *map(float, one.estimate.ravel())) for one in found if one.id is not None]
    else:
        given = supervision.Detections(boxes, confidence=np.array(scores), class_id=np.zeros(len(boxes), int))
        found = tracker.update(given if len(boxes) else supervision.Detections.empty())
        ids = [] if found.tracker_id is None else found.tracker_id
        rows = [(int(i) + 1, *map(float, box)) for i, box in zip(ids, found.xyxy) if i >= 0]
    for target, left, top, right, bottom in rows:
        print(number, target, left + 1.5, top + 1.5, right - left, bottom - top, 1, -1, -1, -1, sep=",")
"""


def ours(name: str, least: float, tracks: Path) -> None:
    """Writes the tracks of `particletrack`."""
    folder, video = shared_data() / "mot" / name, tracks.with_name(f"{name}.mp4")
    if not video.exists():
        restamp(folder / "video.mp4", video, SEQUENCES[name][1])
    Pipeline.parse(
        f"filesrc location={video} ! decode ! detectionsrc location={folder / 'det.txt'} "
        f"min-score={least} ! particletrack max-targets=200 ! tracksink location={tracks}"
    ).run(timeout_s=900)


def restamp(source: Path, copy: Path, rate: int) -> None:
    """Copies a video with `rate` frames a second, not encoded anew."""
    with av.open(str(source)) as video, av.open(str(copy), "w") as output:
        stream = video.streams.video[0]
        assert stream.average_rate is not None
        slower = stream.average_rate / rate
        copied = output.add_stream_from_template(stream)
        for packet in video.demux(stream):
            if packet.dts is None or packet.pts is None:
                continue
            packet.pts, packet.dts = round(packet.pts * slower), round(packet.dts * slower)
            packet.stream = copied
            output.mux(packet)


def peer(method: str, name: str, least: float, tracks: Path, python: str) -> None:
    """Writes the tracks of a peer."""
    table, (length, rate) = read_detections(str(shared_data() / "mot" / name / "det.txt")), SEQUENCES[name]
    frames = []
    for number in range(1, length + 1):
        rows = table.of_frame(number)
        rows = rows[table.scores[rows] >= least]
        frames.append((table.boxes[rows].tolist(), table.relative_scores[rows].tolist()))
    with tracks.open("w") as output:
        subprocess.run(
            [python, "-W", "ignore", "-c", PEERS], input=json.dumps([method, rate, frames]), stdout=output,
            text=True, check=True,
        )  # fmt: skip


def main() -> None:
    """Prints the table: for each tracker the figures without the lowest 0, 25 and 50 % of scores."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--peers", default="")
    python = parser.parse_args().peers
    methods = ("particletrack", *(("SORT", "ByteTrack", "norfair") if python else ()))
    figures = ", ".join(FIGURES)
    print(f"| sequence | tracker | all: {figures} | best 75 %: {figures} | best 50 %: {figures} |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        tracks = Path(folder) / "tracks.txt"
        for name in SEQUENCES:
            truth = shared_data() / "mot" / name
            scores = read_detections(str(truth / "det.txt")).scores
            for method in methods:
                cells = []
                for least in np.quantile(scores, QUANTILES).tolist():
                    if method == "particletrack":
                        ours(name, least, tracks)
                    else:
                        peer(method, name, least, tracks, python)
                    found = score_files(tracks, truth / "gt.txt")
                    cells.append(", ".join(f"{found[figure]:.3g}" for figure in FIGURES))
                print(f"| {name} | {method} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
