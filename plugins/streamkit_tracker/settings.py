"""Every number the tracker works with, in one frozen record."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from streamkit_tracker.eigen_template import EigenSettings
from streamkit_tracker.layered_filter import LayerSettings

CROWD = 6
SMALLEST_PATCH = 16
FEWEST_PARTICLES = 8


@dataclass(frozen=True)
class TrackerSettings:
    """Settings of the multi-target tracker.

    Attributes:
        layers: particles of a target that is searched by its appearance alone.
        seen_layers: particles of a target whose detection was found in the frame.
        eigen: how templates learn.
        patch: largest side of the patches, samples.
        crowd_patch: the same for targets that start while more than six others are followed.
        std_position: position noise of the wide part of layer 1, relative to the window's mean side.
        sigma: standard deviation of the residual in the likelihood exp(-distance / (2 sigma^2)).
        context: side of the sampled window relative to the target, for targets started by detections.
        update_threshold: least similarity at which a patch is learnt.
        lost_threshold: similarity below which the target is not seen.
        lost_frames: frames not seen, neither by appearance nor by detection, from which only a detection
            finds the target again.
        birth_hits: detections that confirm a target ...
        birth_window: ... within so many frames.
        min_travel: ground distance a target has moved before it is confirmed, px of the frame.
        coast_s: longest time without a detection, s; a target never coasts for longer than it was detected.
        max_speed: fastest target expected, px/s of the frame.
        max_targets: most confirmed targets at once; four times as many may be tentative.
        budget_s: what a frame may take before there are fewer particles and looks; 0 is no limit.
        auto_start: whether detections start targets.
        seed: of every target's random generator, together with its id.
    """

    layers: LayerSettings = field(default_factory=LayerSettings)
    seen_layers: LayerSettings = field(
        default_factory=lambda: LayerSettings(particles=32, keep=6, size_particles=2, angle_particles=2)
    )
    eigen: EigenSettings = field(default_factory=EigenSettings)
    patch: int = 32
    crowd_patch: int = 16
    std_position: float = 0.125
    sigma: float = 0.09
    context: float = 1.15
    update_threshold: float = 0.85
    lost_threshold: float = 0.6
    lost_frames: int = 3
    birth_hits: int = 3
    birth_window: int = 5
    min_travel: float = 4.0
    coast_s: float = 3.0
    max_speed: float = 500.0
    max_targets: int = 64
    budget_s: float = 0.0
    auto_start: bool = True
    seed: int = 0

    def patch_for(self, longest_side: float, followed: int) -> int:
        """Side of the patches of a target that starts now: no more samples than its pixels call for.

        Args:
            longest_side: of the sampled window, px.
            followed: number of targets followed already.
        """
        side = self.patch if followed < CROWD else min(self.patch, self.crowd_patch)
        return min(side, max(SMALLEST_PATCH, 8 * math.ceil(longest_side / 8)))

    def layers_for(self, detected: bool, followed: int, share: float = 1.0) -> LayerSettings:
        """Particles for one target: fewer where a detection leads, or in a crowd of more than six.

        Args:
            detected: whether its detection was found in the frame.
            followed: number of targets followed.
            share: part of the usual number, 0 to 1.
        """
        layers = self.seen_layers if detected else self.layers
        if not detected and followed > CROWD:
            share = share / 2
        if share >= 1:
            return layers
        return replace(
            layers,
            particles=max(int(layers.particles * share), FEWEST_PARTICLES),
            size_particles=math.ceil(layers.size_particles * share),
            angle_particles=math.ceil(layers.angle_particles * share),
        )
