"""The position of each frame on the earth, by what the last frames have shown of it."""

import math
from collections import deque
from dataclasses import replace
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, inverse, normalised
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit_stitcher.flight_plan.plan import GeodeticPoint
from streamkit_stitcher.mosaic.frame_views import Position
from streamkit_stitcher.mosaic.georeference import Georeference, GroundView, georeference, local_metres
from streamkit_stitcher.plane.frame_registration import FrameRegistration

# The views of the last forty seconds: over longer times the plane drifts.
_MAX_VIEWS: Final = 200
_INTERVAL_S: Final = 0.2
# Positions over which the velocity is taken: some are sent twice.
_STEPS: Final = 5
# Views that are added between two fits, as a part of those there are.
_GROWTH: Final = 1 / 8


class LiveGround:
    """Fits the current plane to the earth while the flight continues."""

    def __init__(self) -> None:
        self._velocities = deque[FloatArray](maxlen=_STEPS)
        self._last: GroundView | None = None
        self._forget()

    def _forget(self) -> None:
        """Begins another plane."""
        self._views = deque[tuple[FloatArray, GroundView]](maxlen=_MAX_VIEWS)
        self._geo: Georeference | None = None
        self._added, self._last_s = 0, -math.inf

    def locate(self, registered: FrameRegistration, position: Position) -> Georeference | None:
        """That of a frame's pixels, in the order of the stream; None if unknown.

        Args:
            registered: the frame's place on the plane.
            position: what telemetry tells of it, or why that is unknown.
        """
        change = registered.reference_change
        if registered.status is RegistrationStatus.CUT:
            self._forget()
        elif change is not None:
            moved = [(normalised(change @ matrix), view) for matrix, view in self._views]
            self._views = deque(moved, _MAX_VIEWS)
            self._geo = None if self._geo is None else self._geo.seen_through(change)
        if registered.status is RegistrationStatus.LOST:
            return None
        if isinstance(position, GroundView):
            self._velocities.append(_velocity(self._last, position))
            self._last = position
            if registered.measured:
                self._add(registered.to_reference, position)
        if self._geo is None:
            return None
        error_m = math.hypot(self._geo.error_m, self._geo.lead_error_m(self._velocities))
        return replace(self._geo.seen_through(inverse(registered.to_reference)), error_m=error_m)

    def _add(self, to_plane: FloatArray, view: GroundView) -> None:
        """Adds a view where the last one is old enough, and fits again once there are enough others."""
        if view.time_s is not None and 0 <= view.time_s - self._last_s < _INTERVAL_S:
            return
        self._last_s = -math.inf if view.time_s is None else view.time_s
        self._views.append((to_plane, view))
        self._added += 1
        if self._geo is None or self._added > _GROWTH * len(self._views):
            self._geo = georeference(*zip(*self._views, strict=True))
            self._added = 0


def _velocity(before: GroundView | None, view: GroundView) -> FloatArray:
    """Velocity over the ground of what the middle of the frame shows, m/s; 0 where it is unknown."""
    if before is None or before.time_s is None or view.time_s is None or view.time_s <= before.time_s:
        return np.zeros(2)
    step = local_metres(view.places[:1], GeodeticPoint(*before.places[0].tolist()))[0]
    return np.asarray(step / (view.time_s - before.time_s))
