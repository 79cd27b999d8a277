"""Compiles the stitcher's kernels before the first frame."""

import streamkit_stitcher.registration.patch_steps  # noqa: F401  holds the kernels
from streamkit_kernels import prepare


def warm_up() -> None:
    """Compiles the kernels, or loads them from the cache: else the stream waits at its first keyframe."""
    prepare("streamkit_stitcher")
