from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

import streamkit
from streamkit import Detections, Frame


def detect(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Stands for your detector: boxes of what is bright and has the size of a car."""
    bright = cv2.inRange(image, np.array([200, 200, 200]), np.array([255, 255, 255]))
    contours, _ = cv2.findContours(bright, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    rectangles = np.array([cv2.boundingRect(contour) for contour in contours], np.float64).reshape(-1, 4)
    corners, sizes = rectangles[:, :2], rectangles[:, 2:]
    return np.hstack([corners, corners + sizes])[((sizes > 8) & (sizes < 40)).all(axis=1)]


def detected(name: str) -> Iterator[Frame]:
    with streamkit.open(name) as video:
        for frame in video:
            boxes = detect(frame.data)
            sizes = boxes[:, 2:] - boxes[:, :2]
            yield frame.attach(
                Detections(
                    centroids=boxes[:, :2] + sizes / 2,
                    boxes=boxes,
                    areas=sizes.prod(axis=1),
                    scores=np.ones(len(boxes)),
                    are_objects=True,
                )
            )


with streamkit.open(detected("flight.mp4"), "stitch ! particletrack") as video:
    for frame in video:
        print(frame.seq, [track.id for track in frame.tracks])
