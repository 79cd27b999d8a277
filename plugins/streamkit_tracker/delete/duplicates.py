"""Ends the younger of two targets that are on one object."""

from __future__ import annotations

import numpy as np

from streamkit_tracker.targets import TargetTable, dormant, followed
from streamkit_tracker.window_geometry import LENGTH, WIDTH, inside_windows

MERGE_FRAMES = 3
MERGE_SCALE = 0.9

Closeness = dict[tuple[int, int], int]


def end_duplicates(table: TargetTable, lost_frames: int, closeness: Closeness) -> Closeness:
    """Ends the younger of two targets that were on one object, with one velocity, for some frames.

    Two whole targets with a detection each are two, however near.

    Args:
        table: of the targets.
        lost_frames: see `dormant`.
        closeness: for how many frames pairs of ids have been on one object.

    Returns:
        The same up to this frame.
    """
    members = np.flatnonzero(followed(table.rows) & ~dormant(table.rows, lost_frames))
    rows, found = table.rows[members], Closeness()
    window, velocity, covariance = rows["window"], rows["mean"][:, 2:], rows["covariance"]
    # differences of velocities below these say nothing, px/s
    doubt = np.sqrt(window[:, LENGTH] * window[:, WIDTH])
    doubt += np.sqrt((covariance[:, 2, 2] + covariance[:, 3, 3]) / 2)
    apart = np.hypot(*(velocity[:, None] - velocity).T)
    inside = inside_windows(window[:, :2], window, MERGE_SCALE)
    close = (inside | inside.T) & (apart < np.maximum(doubt[:, None], doubt))
    detected = rows["whole"] & (rows["detection"] >= 0)
    close &= ~(detected[:, None] & detected)
    for older, younger in np.argwhere(np.triu(close, k=1)).tolist():
        both = (rows["id"].item(older), rows["id"].item(younger))
        found[both] = closeness.get(both, 0) + 1
        if found[both] >= MERGE_FRAMES:
            table.lose(members.item(younger), f"was on the same object as {both[0]}")
    return found
