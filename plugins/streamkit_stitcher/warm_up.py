"""Makes the compiled loops ready before the first frame."""

import streamkit_stitcher.registration.patch_steps  # noqa: F401  its kernels are what is prepared
from streamkit_kernels import prepare


def warm_up() -> None:
    """Compiles the loops, or reads them from the cache: else a stream waits at its first keyframe."""
    prepare("streamkit_stitcher")
