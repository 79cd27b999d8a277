"""Settings of the placing of pictures on a reference plane."""

from dataclasses import dataclass, field
from enum import StrEnum

from streamkit_stitcher.registration.motion_models import FitLimits


class ReferenceChoice(StrEnum):
    """Whose plane the pictures are placed on: the middle one's as the strip grows, or the first one's.

    `auto` is the middle one where the length of the strip is known beforehand, else the first.
    """

    AUTO = "auto"
    CENTER = "center"
    FIRST = "first"


class ModelChoice(StrEnum):
    """What the motion between pictures may be; `auto` takes the simplest that explains them."""

    AUTO = "auto"
    HOMOGRAPHY = "homography"
    AFFINE = "affine"
    SIMILARITY = "similarity"


@dataclass(frozen=True)
class PlaneSettings:
    """Settings of a `PlaneTracker`.

    Attributes:
        working_width: width that pictures are reduced to for following, px.
        max_points: corners followed from picture to picture.
        limits: what a motion must reach; the threshold counts in reduced px.
        keyframe_overlap: least part of a picture that lies on its key picture, 0 to 1; below it the picture
            becomes a key picture itself.
        keyframe_interval: pictures after which one becomes a key picture in any case, 0 for never.
        max_keyframes: key pictures kept for looking back.
        model: what the motion may be.
        reference: whose plane is the reference.
        strip_length: key pictures of the whole strip where the flight plan tells, 0 for unknown.
        window: newest key pictures that are adjusted together at each new one, 0 for no adjustment.
        adjustment_iterations: most steps of such an adjustment.
        huber: residual from which it trusts a tie point less, px.
        max_adjusted: most key pictures of an adjustment over everything.
    """

    working_width: int = 640
    max_points: int = 220
    limits: FitLimits = field(default_factory=FitLimits)
    keyframe_overlap: float = 0.65
    keyframe_interval: int = 0
    max_keyframes: int = 128
    model: ModelChoice = ModelChoice.AUTO
    reference: ReferenceChoice = ReferenceChoice.CENTER
    strip_length: int = 0
    window: int = 12
    adjustment_iterations: int = 8
    huber: float = 1.5
    max_adjusted: int = 400
