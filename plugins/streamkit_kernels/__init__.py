"""Loops over pixels as machine code, and matrix products on the calling thread.

A library for plugins, independent of the engine.

@kernel(BYTES, BYTES)
def darken(image, darker):
    for row in range(image.shape[0]):
        ...

prepare("my_package")
"""

from streamkit_kernels.calling_thread import LARGEST_PRODUCT as LARGEST_PRODUCT
from streamkit_kernels.calling_thread import product as product
from streamkit_kernels.compilation import BLOCKS as BLOCKS
from streamkit_kernels.compilation import BYTES as BYTES
from streamkit_kernels.compilation import COMPILING as COMPILING
from streamkit_kernels.compilation import FLAGS as FLAGS
from streamkit_kernels.compilation import FLOATS as FLOATS
from streamkit_kernels.compilation import INPUT as INPUT
from streamkit_kernels.compilation import PAIRS as PAIRS
from streamkit_kernels.compilation import TABLE as TABLE
from streamkit_kernels.compilation import VIEW as VIEW
from streamkit_kernels.compilation import compiled as compiled
from streamkit_kernels.compilation import kernel as kernel
from streamkit_kernels.compilation import on_compilation as on_compilation
from streamkit_kernels.compilation import prepare as prepare
