"""Settings of the tracker: each is a property of particletrack, too."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

from streamkit.settings import setting
from streamkit_tracker.appearance.eigen_template import EigenSettings
from streamkit_tracker.update.layered_filter import LayerSettings

CROWD = 6  # targets: more get fewer samples
MIN_PATCH = 16


@dataclass(frozen=True)
class TrackerSettings:
    """Settings of the multi-target tracker.

    Attributes:
        seen_layers: particles of a target whose detection was found in the frame.
        layers: particles of a target that is searched by its appearance alone.
        eigen: how templates learn.
    """

    seen_layers: ClassVar = LayerSettings(particles=32, keep=6, size_particles=2, angle_particles=2)

    auto_start: bool = setting(True, doc="Whether detections start targets.")
    max_targets: int = setting(
        200, min=1, max=1000, doc="Confirmed targets at once; 4 times as many tentative."
    )
    budget_ms: float = setting(
        0.0,
        min=0.0,
        max=10_000.0,
        unit="ms",
        doc="Time for a frame before particles and searches become fewer; 0 is no limit, and repeatable.",
    )
    birth_hits: int = setting(3, min=1, max=100, doc="Detections that confirm a target.")
    birth_window: int = setting(5, min=1, max=100, unit="frames", doc="The frames they have to lie in.")
    birth_score: float = setting(
        0.33,
        min=0.0,
        max=1.0,
        doc="Mean score of the last detections of a region of motion before it is confirmed.",
    )
    min_travel: float = setting(
        4.0,
        min=0.0,
        unit="px",
        doc="Distance over the ground before a target is confirmed; 0 is off.",
    )
    lasting_hits: int = setting(
        15,
        min=0,
        max=100,
        doc="A target of regions of motion is confirmed once most of the earlier ones that were detected as "
        "often reached so many detections, at 25 a second; at a lower rate those of the same time. 0 is off.",
    )
    max_speed: float = setting(500.0, min=1.0, unit="px/s", doc="Fastest target expected, in frame pixels.")
    coast: float = setting(3.0, min=0.0, unit="s", doc="Longest time without a detection.")
    lost_threshold: float = setting(0.6, min=0.0, max=1.0, doc="Similarity below which a target is unseen.")
    lost_frames: int = setting(
        3, min=1, max=1000, unit="frames", doc="Unseen frames from which only a detection finds it."
    )
    update_threshold: float = setting(
        0.85, min=0.0, max=1.0, doc="Similarity from which the template learns; low values learn the ground."
    )
    layers: LayerSettings = field(default_factory=LayerSettings)
    std_position: float = setting(
        0.125, min=0.001, max=5.0, doc="Wide position noise, relative to the target's mean side."
    )
    sigma: float = setting(
        0.09, min=0.001, max=10.0, doc="Standard deviation of the residual in the likelihood."
    )
    patch: int = setting(
        32, min=8, max=128, unit="samples", doc="Largest side of the compared patches; 16 in a crowd."
    )
    eigen: EigenSettings = field(default_factory=EigenSettings)
    seed: int = setting(0, min=0, doc="Same seed and same frames give the same tracks.")

    def patch_for(self, longest_side: float, followed: int) -> int:
        """Side of the patches of a target that starts now: no more samples than its pixels call for.

        Its window has the longest side `longest_side`, px; `followed` targets are followed already.
        """
        side = self.patch if followed < CROWD else min(self.patch, MIN_PATCH)
        return min(side, max(MIN_PATCH, 8 * math.ceil(longest_side / 8)))
