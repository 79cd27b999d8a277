"""The ready pipeline that shows detection, run from the command line."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).parents[3]
STREAMKIT = Path(sys.executable).with_name("streamkit")


def test_detections_and_masks_of_every_frame(tmp_path):
    """A line and a mask for each frame, and detections where the masks are white."""
    settings = {
        "frames": 26,
        "width": 480,
        "height": 320,
        "cars": 12,
        "output": "found.jsonl",
        "masks": "masks",
    }
    options = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    done = subprocess.run(
        [str(STREAMKIT), "launch", "-q", "-f", str(ROOT / "pipelines" / "detections.pipe"), *options],
        cwd=tmp_path, timeout=80, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    masks = sorted((tmp_path / "masks").iterdir())
    assert [path.name for path in masks] == [f"bin{number:06d}.png" for number in range(1, 27)]
    lines = [json.loads(line) for line in (tmp_path / "found.jsonl").read_text().splitlines()]
    assert [line["frame"] for line in lines] == list(range(1, 27))
    places = [(line["frame"], found["box"]) for line in lines for found in line["detections"]]
    assert len(places) > 10
    for number, box in places:
        mask = cv2.imread(str(masks[number - 1]), cv2.IMREAD_UNCHANGED)
        left, top, right, bottom = (round(edge + 0.5) for edge in box)
        assert np.count_nonzero(mask[top:bottom, left:right]) > 0
