"""Makes the compiled loops ready before the first frame."""

import streamkit_differencer.differencer  # noqa: F401  its kernels are what is prepared
from streamkit_kernels import prepare


def warm_up() -> None:
    """Compiles the loops, or reads them from the cache: else the first frames of a live feed would wait."""
    prepare("streamkit_differencer")
