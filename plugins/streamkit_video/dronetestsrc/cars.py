"""Simulated traffic: cars that drive smooth curves in view of the camera."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LENGTHS = (20.0, 30.0)
WIDTHS = (10.0, 13.0)
SPEEDS = (1.5, 6.0)
TURNING_RADIUS = 45.0
ACCELERATION = 0.08
STEERING_LAG = 0.15
INSET = 0.12  # goals keep this share of the frame away from its border
LOOK_AHEAD = 25  # goals are placed in the view of so many frames later: otherwise slow cars are left behind
ARRIVED = 60.0
GOAL_TIMEOUT = 260  # a car that circles around its goal gets another one after this many frames
HORIZON = 40.0  # cars avoid collisions within this many frames
CLEARANCE = 40.0
TOO_NEAR = 32.0
HEAD_ON = 8.0
EVASION = 3.0
START_DISTANCE = 70.0


class Traffic:
    """The state of all cars, which begin spread over the first frame; `step` advances it by one frame.

    Lengths are in ground px; the constants of this module are frame px at the camera's mean altitude.

    Args:
        count: number of cars.
        frame_size: width, height, px.
        ground_from_frame: float64[3, 3], the first frame's homography to the ground.
        scale: ground px per frame px at mean altitude.
        seed: of positions, sizes, speeds and goals.

    Attributes:
        positions: float64[n, 2], centres of the bodies.
        headings: float64[n], rad from +x towards +y.
        speeds: float64[n], ground px per frame.
        lengths: float64[n].
        widths: float64[n].
    """

    def __init__(
        self, count: int, frame_size: tuple[int, int], ground_from_frame: FloatArray, scale: float, seed: int
    ) -> None:
        random = self._random = np.random.default_rng((seed, 2))
        self._scale, self._frame_size = scale, frame_size
        self.positions: FloatArray = np.empty((0, 2))
        for _ in range(count):
            tries = self._random_positions(30, ground_from_frame)
            gaps = np.hypot(*(tries[:, None] - self.positions[None]).transpose(2, 0, 1))
            best = int(gaps.min(axis=1, initial=START_DISTANCE * scale).argmax())
            self.positions = np.vstack([self.positions, tries[best : best + 1]])
        self._cruising = np.sort(random.uniform(*SPEEDS, count))[random.permutation(count)] * scale
        self.speeds = self._cruising.copy()
        self.headings = random.uniform(-np.pi, np.pi, count)
        self.lengths = random.uniform(*LENGTHS, count) * scale
        self.widths = random.uniform(*WIDTHS, count) * scale
        self._curvatures = np.zeros(count)
        self._goals = self._random_positions(count, ground_from_frame)
        self._ages = np.zeros(count, dtype=np.int64)

    def __len__(self) -> int:
        return len(self.headings)

    def step(self, ground_from_frame: FloatArray) -> None:
        """Advances by one frame, given the camera's float64[3, 3] homography `LOOK_AHEAD` frames later."""
        if not len(self):
            return
        self._choose_goals(ground_from_frame)
        outside = ~self._in_view(self.positions, ground_from_frame, 0.0)
        to_goal = self._goals - self.positions
        turns = _wrapped(np.arctan2(to_goal[:, 1], to_goal[:, 0]) - self.headings)
        evasion, braking = self._avoid_collisions()
        tightest = 1.0 / (TURNING_RADIUS * self._scale)
        wanted = np.clip(turns / (ARRIVED * self._scale) + evasion * tightest, -tightest, tightest)
        self._curvatures += STEERING_LAG * (wanted - self._curvatures)
        cruising = np.where(outside, SPEEDS[1] * self._scale, self._cruising)
        cruising = np.where(braking, SPEEDS[0] * self._scale, cruising)
        most = ACCELERATION * self._scale * np.where(braking, 2.0, 1.0)
        self.speeds += np.clip(cruising - self.speeds, -most, most)
        turned = self._curvatures * self.speeds
        directions = self.headings + turned / 2.0
        self.positions += self.speeds[:, None] * np.stack([np.cos(directions), np.sin(directions)], axis=1)
        self.headings = _wrapped(self.headings + turned)

    def _in_view(self, points: FloatArray, ground_from_frame: FloatArray, inset: float) -> BoolArray:
        """Which points of the ground are in view, not within a share `inset` of the border."""
        seen = cv2.perspectiveTransform(points[None], np.linalg.inv(ground_from_frame))[0]
        size = np.array(self._frame_size, dtype=np.float64) - 1.0
        return np.asarray(((seen >= inset * size) & (seen <= (1.0 - inset) * size)).all(axis=1))

    def _choose_goals(self, ground_from_frame: FloatArray) -> None:
        """Gives a new goal to cars that arrived, timed out or whose goal left the view."""
        self._ages += 1
        near = np.hypot(*(self._goals - self.positions).T) < ARRIVED * self._scale
        seen = self._in_view(self._goals, ground_from_frame, INSET)
        due = near | ~seen | (self._ages > GOAL_TIMEOUT)
        if due.any():
            self._goals[due] = self._random_positions(int(due.sum()), ground_from_frame)
            self._ages[due] = 0

    def _avoid_collisions(self) -> tuple[FloatArray, BoolArray]:
        """Steering away from cars that would come too close (-1 left, 1 right), and which cars brake.

        A car steers away from the side on which the other is, now if they are near, else at their closest
        approach; head-on both turn right. The car with the other on its right brakes, so that two cars never
        wait for each other.
        """
        directions = np.stack([np.cos(self.headings), np.sin(self.headings)], axis=1)
        velocities = self.speeds[:, None] * directions
        # Row i, column j is how car j looks from car i, px and frames, if both go straight on.
        apart = (self.positions[None, :] - self.positions[:, None]) / self._scale
        approach = (velocities[None, :] - velocities[:, None]) / self._scale
        closing = -np.einsum("ijk,ijk->ij", apart, approach)
        moments = closing / np.maximum(np.einsum("ijk,ijk->ij", approach, approach), 1e-3)
        closest = apart + approach * moments.clip(0.0, HORIZON)[..., None]
        is_near = (np.hypot(apart[..., 0], apart[..., 1]) < TOO_NEAR) & ~np.eye(len(self), dtype=bool)
        is_approaching = (closing > 0.0) & (moments < HORIZON)
        is_danger = is_near | (is_approaching & (np.hypot(closest[..., 0], closest[..., 1]) < CLEARANCE))
        side_now, side_then = _to_the_right(directions, apart), _to_the_right(directions, closest)
        is_right = np.where(is_near, side_now > 0.0, side_then > HEAD_ON)
        urgency = 1.0 - moments.clip(0.0, HORIZON) / HORIZON
        evasion = (is_danger * np.where(is_right, -1.0, 1.0) * (0.5 + urgency)).sum(axis=1)
        is_ahead = np.einsum("ijk,ik->ij", apart, directions) > 0.0
        gives_way = is_near | (side_now > -HEAD_ON)
        braking = (is_danger & is_ahead & gives_way).any(axis=1)
        return EVASION * np.clip(evasion, -1.0, 1.0), braking

    def _random_positions(self, count: int, ground_from_frame: FloatArray) -> FloatArray:
        """float64[count, 2] ground positions, uniform over the inner part of the frame."""
        if count == 0:
            return np.empty((0, 2))
        shares = self._random.uniform(INSET, 1.0 - INSET, (count, 2))
        points = shares * (np.array(self._frame_size, dtype=np.float64) - 1.0)
        return np.asarray(cv2.perspectiveTransform(points[None], ground_from_frame)[0], dtype=np.float64)


def _to_the_right(directions: FloatArray, gaps: FloatArray) -> FloatArray:
    """How far to the right of its direction, float64[n, 2], each row of gaps, float64[n, n, 2], leads."""
    return np.asarray(directions[:, None, 0] * gaps[..., 1] - directions[:, None, 1] * gaps[..., 0])


def _wrapped(angles: FloatArray) -> FloatArray:
    """Angles in [-pi, pi)."""
    return np.asarray((angles + np.pi) % (2.0 * np.pi) - np.pi)
