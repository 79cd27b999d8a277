"""Settings of the placing of pictures on a reference plane."""

from dataclasses import dataclass, field

from streamkit_stitcher.registration.motion_models import FitLimits


@dataclass(frozen=True)
class PlaneSettings:
    """Settings of a `PlaneTracker`.

    Attributes:
        working_width: width that pictures are reduced to for following, px.
        max_points: corners followed from picture to picture.
        limits: what a motion must reach; the threshold counts in reduced px.
        keyframe_overlap: least part of a picture that lies on its key picture, 0 to 1; below it the picture
            becomes a key picture itself.
        max_keyframes: key pictures kept for looking back.
    """

    working_width: int = 640
    max_points: int = 220
    limits: FitLimits = field(default_factory=FitLimits)
    keyframe_overlap: float = 0.65
    max_keyframes: int = 128
