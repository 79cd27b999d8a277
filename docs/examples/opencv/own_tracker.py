import numpy as np
from numpy.typing import NDArray

import streamkit
from streamkit import Detections, Frame, Track, Tracks, TrackState, Transform

REACH_PX = 20.0


@streamkit.register_element
class NearestTrack(Transform):
    """Stands for your tracker: a detection has the id of the nearest one in the frame before."""

    sink = src = "video/x-raw"

    def start(self) -> None:
        """Forgets the targets of an earlier run."""
        self.count = 0
        self.before: dict[int, NDArray[np.float64]] = {}

    def transform(self, frame: Frame) -> Frame:
        """Attaches the tracks of a frame, in order of their ids."""
        found = frame.get(Detections)
        if found is None:
            return frame
        centres = {self.id_of(centre): centre for centre in found.centroids}
        sizes = found.boxes[:, 2:] - found.boxes[:, :2]
        tracks = [
            Track(
                id=number,
                state=TrackState.CONFIRMED,
                x=centre[0],
                y=centre[1],
                length=size[0],
                width=size[1],
                angle=0.0,
                velocity=(0.0, 0.0),  # not measured here
                covariance=np.eye(2),
                score=score,
                age_ns=0,
            )
            for (number, centre), size, score in zip(centres.items(), sizes, found.scores, strict=True)
        ]
        self.before = centres
        return frame.attach(Tracks(tuple(sorted(tracks, key=lambda track: track.id))))

    def id_of(self, centre: NDArray[np.float64]) -> int:
        """The id of the nearest target in reach that no other detection has taken, or a new one."""
        distances = {number: np.hypot(*(centre - old)) for number, old in self.before.items()}
        nearest = min(distances, key=distances.__getitem__, default=0)
        if not distances or distances[nearest] > REACH_PX:
            self.count += 1
            return self.count
        del self.before[nearest]
        return nearest


with streamkit.open("flight.mp4", "stitch ! framediff ! nearesttrack") as video:
    for frame in video:
        print(frame.seq, [track.id for track in frame.tracks])
