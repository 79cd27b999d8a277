from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

import streamkit


def images(capture: cv2.VideoCapture) -> Iterator[NDArray[np.uint8]]:
    while True:
        is_read, image = capture.read()
        if not is_read:
            return
        yield np.asarray(image, np.uint8)


capture = cv2.VideoCapture("flight.mp4")
framerate = capture.get(cv2.CAP_PROP_FPS)
with streamkit.open(images(capture), "stitch ! framediff ! particletrack", framerate=framerate) as video:
    for frame in video:
        shown = [track for track in frame.tracks if track.state in streamkit.SHOWN_STATES]
        print(f"{(frame.pts or 0) / 1e9:.2f} s: {len(shown)} targets")
