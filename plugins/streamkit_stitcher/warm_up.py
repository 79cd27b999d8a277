"""Compiles or loads the stitcher's kernels before the first frame."""

import streamkit_stitcher.registration.block_sums
import streamkit_stitcher.registration.patch_steps  # noqa: F401
from streamkit_kernels import prepare


def warm_up() -> None:
    """Else the stream waits at its first alignment."""
    prepare("streamkit_stitcher")
