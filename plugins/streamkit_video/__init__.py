"""Raw video: test sources with ground truth, conversion, scaling, and drawing of tracks."""

from streamkit_video.dronetestsrc.truth import TrueRegistration, TrueTargets

__all__ = ["TrueRegistration", "TrueTargets"]
