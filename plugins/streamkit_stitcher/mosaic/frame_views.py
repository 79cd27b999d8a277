"""What the frames of a mosaic show of the earth, and its position by that."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, centre, inverse, normalised, project
from streamkit.geometry.posed_camera import POSITION_STD_M
from streamkit_stitcher.bundle_adjustment.lens import Lens
from streamkit_stitcher.mosaic.georeference import Georeference, GroundView, georeference

# Focal lengths of a lens that does not zoom differ by less, as a part.
_SAME_FOCAL: Final = 0.02
# Spread of the cameras, as a part of that of what they show, from which they tell turn and scale.
_WIDE: Final = 0.5

# What a frame shows, or why that is unknown.
Position = GroundView | str | None


@dataclass(frozen=True, eq=False)
class FrameView:
    """What a frame shows of the earth.

    Attributes:
        key_index: the keyframe it was measured against.
        to_key: float64[3, 3], its pixels to those of the keyframe.
        shape: height and width, px.
        position: what it shows, or why that is unknown.
    """

    key_index: int
    to_key: FloatArray
    shape: tuple[int, int]
    position: GroundView | str


def focal_length(views: Sequence[FrameView]) -> float:
    """The focal length of all frames, px; 0 where it is unknown or they differ."""
    found = [view.position.focal_px for view in views if isinstance(view.position, GroundView)]
    if not found or not min(found) > 0 or np.ptp(found) > _SAME_FOCAL * max(found):
        return 0.0
    return float(np.median(found))


def georeferenced(
    homographies: Mapping[int, FloatArray],
    views: Sequence[FrameView],
    max_m: float,
    focal_px: float = 0.0,
) -> tuple[Georeference | None, str]:
    """A plane's position on the earth, if it can be known, and why it is not to be used, or nothing.

    Args:
        homographies: of the plane's keyframes.
        views: of all planes' frames.
        max_m: largest expected error, m.
        focal_px: focal length that the homographies were adjusted with, or 0. They tell the tilt of cameras
            better than telemetry does: where these are spread over the mosaic, only their places are used.
    """
    own = [view for view in views if view.key_index in homographies]
    known = [(view, view.position) for view in own if isinstance(view.position, GroundView)]
    matrices = [normalised(homographies[view.key_index] @ view.to_key) for view, _ in known]
    geo = georeference(matrices, [position for _, position in known])
    if focal_px > 0 and geo is not None:
        below = [
            _camera(position, matrix, Lens(focal_px, centre(view.shape)))
            for (view, position), matrix in zip(known, matrices, strict=True)
        ]
        by_cameras = georeference(matrices, below)
        if by_cameras is not None and by_cameras.spread_m > _WIDE * geo.spread_m:
            geo = by_cameras
    if geo is None:
        reasons = Counter(view.position for view in own if isinstance(view.position, str))
        if reasons and not known:
            return None, reasons.most_common(1)[0][0]
        return None, f"{len(known)} frames with a position; 3 are needed, some metres apart"
    if geo.error_m > max_m:
        return geo, f"the expected error is {geo.error_m:.1f} m, above max-geo-error-m={max_m:g}"
    return geo, ""


def _camera(view: GroundView, matrix: FloatArray, lens: Lens) -> GroundView:
    """The place of the camera, and the pixel below it, which is not in the middle of a tilted frame."""
    if view.camera is None:
        return view
    to_frame = inverse(matrix)
    foot = project(to_frame, lens.foot(to_frame)[np.newaxis])
    return replace(view, pixels=foot, places=view.camera[np.newaxis], std_m=POSITION_STD_M)
