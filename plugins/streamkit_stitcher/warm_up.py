"""Compiles or loads the stitcher's kernels before the first frame."""

import streamkit_stitcher.plane.registrar  # noqa: F401  its modules have all kernels
from streamkit_kernels import prepare


def warm_up() -> None:
    """Else the stream waits at its first alignment."""
    prepare("streamkit_stitcher")
