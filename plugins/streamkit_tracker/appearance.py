"""What a followed target looks like."""

from __future__ import annotations

from dataclasses import dataclass

from streamkit_tracker.appearance_search import Template, read_window
from streamkit_tracker.correlation_filter import CorrelationFilter
from streamkit_tracker.eigen_template import EigenSettings, EigenTemplate
from streamkit_tracker.feature_template import FeatureTemplate, Space
from streamkit_tracker.layered_filter import Cloud
from streamkit_tracker.window_geometry import FloatArray
from streamkit_tracker.window_sampling import WindowSampler


@dataclass(eq=False)
class Appearance:
    """A target's template and where its particles are.

    Attributes:
        template: what windows are compared with.
        cloud: the particles.
        patch: samples of a patch (rows, columns).
        context: side of the sampled window relative to the target's.
        discriminator: tells the target from the ground around it, for targets drawn by hand.
    """

    template: Template
    cloud: Cloud
    patch: tuple[int, int]
    context: float
    discriminator: CorrelationFilter | None = None

    @classmethod
    def of(
        cls,
        sampler: WindowSampler,
        window: FloatArray,
        patch: tuple[int, int],
        context: float,
        space: Space | None,
        settings: EigenSettings,
        *,
        discriminated: bool,
    ) -> Appearance:
        """Learns the look of a window, float64[5], in the sampler's frame.

        Args:
            sampler: has been shown the frame.
            window: where the target is.
            patch: samples of a patch.
            context: see `Appearance`.
            space: to compare in, or None for a template of the target's own.
            settings: how such a template learns.
            discriminated: whether to train a discriminator.
        """
        pixels = read_window(sampler, window, patch, context)
        template: Template = (
            EigenTemplate(pixels, settings) if space is None else FeatureTemplate(pixels, space)
        )
        discriminator = CorrelationFilter(sampler, window) if discriminated else None
        return cls(template, Cloud.at(window), patch, context, discriminator)
