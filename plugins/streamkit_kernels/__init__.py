"""What the algorithms of several plugins share, independent of the engine.

Loops compiled to machine code, matrix products on the calling thread, masks of what hides the scene.

@kernel(UINT8, UINT8)
def darken(image, darker):
    for row in range(image.shape[0]):
        ...

prepare("my_package")
"""

from streamkit_kernels.calling_thread import MAX_PRODUCT as MAX_PRODUCT
from streamkit_kernels.calling_thread import product as product
from streamkit_kernels.compilation import BOOL_1D as BOOL_1D
from streamkit_kernels.compilation import FLOAT32 as FLOAT32
from streamkit_kernels.compilation import FLOAT32_STRIDED as FLOAT32_STRIDED
from streamkit_kernels.compilation import FLOAT64 as FLOAT64
from streamkit_kernels.compilation import FLOAT64_1D as FLOAT64_1D
from streamkit_kernels.compilation import INT32 as INT32
from streamkit_kernels.compilation import INT64_1D as INT64_1D
from streamkit_kernels.compilation import UINT8 as UINT8
from streamkit_kernels.compilation import UINT8_1D as UINT8_1D
from streamkit_kernels.compilation import UINT8_READONLY as UINT8_READONLY
from streamkit_kernels.compilation import UINT8_STRIDED as UINT8_STRIDED
from streamkit_kernels.compilation import UINT16 as UINT16
from streamkit_kernels.compilation import compiled as compiled
from streamkit_kernels.compilation import kernel as kernel
from streamkit_kernels.compilation import named_tuple as named_tuple
from streamkit_kernels.compilation import prepare as prepare
from streamkit_kernels.compilation import start_kernels as start_kernels
