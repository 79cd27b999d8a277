"""Makes the compiled loops ready before the first frame."""

import streamkit_wavelet_eigen.appearance  # noqa: F401  its kernels are what is prepared
from streamkit_kernels import prepare


def warm_up() -> None:
    """Compiles the loops, or reads them from the cache: else the first targets of a live feed would wait."""
    prepare("streamkit_wavelet_eigen")
