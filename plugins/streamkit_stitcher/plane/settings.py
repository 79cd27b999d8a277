"""Settings of the registration of frames to a reference plane."""

from dataclasses import dataclass, field
from enum import StrEnum

from streamkit.settings import setting
from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings
from streamkit_stitcher.registration.motion_models import FitLimits


class ReferenceChoice(StrEnum):
    """Which keyframe is the reference plane: the middle one, which changes as the strip grows, or the first.

    `auto` is the middle one where the length of the strip is known, else the first.
    """

    AUTO = "auto"
    CENTER = "center"
    FIRST = "first"


class ModelChoice(StrEnum):
    """Motion model between frames; `auto` selects the simplest that explains them."""

    AUTO = "auto"
    HOMOGRAPHY = "homography"
    AFFINE = "affine"
    SIMILARITY = "similarity"


@dataclass(frozen=True)
class PlaneSettings:
    """Settings of a `FrameRegistrar`.

    Attributes:
        limits: what a motion must reach; the threshold is in px at registration width.
        adjustment: settings of the bundle adjustment; the registration sets the motion model.
        keyframe_interval: frames after which one becomes a keyframe in any case, 0 for never.
        max_keyframes: keyframes kept for matching.
        max_adjusted: most keyframes of an adjustment of the whole plane.
    """

    reference: ReferenceChoice = setting(
        ReferenceChoice.AUTO,
        doc="Reference plane: the middle keyframe's, which changes as the strip grows, or the first frame's; "
        "auto takes the middle where the strip's length is known.",
    )
    model: ModelChoice = setting(
        ModelChoice.AUTO, doc="Motion model; auto selects the simplest that explains the frames."
    )
    registration_width: int = setting(
        640, min=64, max=4096, unit="px", doc="Frames are halved to this width or less to follow the motion."
    )
    max_points: int = setting(
        220, min=20, max=2000, doc="Points compared in each frame; more is slower and steadier."
    )
    limits: FitLimits = field(default_factory=FitLimits)
    keyframe_overlap: float = setting(
        0.65,
        min=0.3,
        max=0.95,
        doc="A frame that overlaps its keyframe by less than this becomes a keyframe.",
    )
    window: int = setting(
        12, min=0, max=60, doc="Newest keyframes adjusted together at each new one; 0 for no adjustment."
    )
    adjustment: AdjustmentSettings = field(default_factory=AdjustmentSettings)
    strip_length: int = setting(
        0, min=0, max=100_000, doc="Keyframes of the whole flight strip; 0 if unknown."
    )
    keyframe_interval: int = 0
    max_keyframes: int = 128
    max_adjusted: int = 400

    @property
    def is_centred(self) -> bool:
        """Whether the reference is the middle keyframe."""
        if self.reference is ReferenceChoice.AUTO:
            return self.strip_length > 0
        return self.reference is ReferenceChoice.CENTER
