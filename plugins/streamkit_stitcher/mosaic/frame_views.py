"""What the frames of a mosaic show of the earth, and its position by that."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from streamkit.geometry.homography import FloatArray, normalised
from streamkit_stitcher.flight_plan.plan import GeodeticPoint
from streamkit_stitcher.mosaic.georeference import Georeference, GroundView, georeference

# What is known of a frame's position, or why nothing is.
Position = GeodeticPoint | GroundView | str | None


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
    position: GeodeticPoint | GroundView | str


def georeferenced(
    homographies: Mapping[int, FloatArray], views: Sequence[FrameView], most_m: float
) -> tuple[Georeference | None, str]:
    """A plane's position on the earth, if it can be known, and why it is not to be used, or nothing.

    Args:
        homographies: of the plane's keyframes.
        views: of all planes' frames.
        most_m: largest expected error, m.
    """
    own = [view for view in views if view.key_index in homographies]
    known = [(view, view.position) for view in own if isinstance(view.position, GeodeticPoint | GroundView)]
    geo = georeference(
        [normalised(homographies[view.key_index] @ view.to_key) for view, _ in known],
        [view.shape for view, _ in known],
        [position for _, position in known],
    )
    if geo is None:
        reasons = Counter(view.position for view in own if isinstance(view.position, str))
        if reasons and not known:
            return None, reasons.most_common(1)[0][0]
        return None, f"{len(known)} frames with a position; 3 are needed, some metres apart"
    if geo.error_m > most_m:
        return geo, f"the expected error is {geo.error_m:.1f} m, above max-geo-error-m={most_m:g}"
    return geo, ""
