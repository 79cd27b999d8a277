"""streamkit: a frame-stream graph engine whose elements come from plugins.

The public names are listed in `__init__.pyi`; each is imported when it is first used, for a fast start.
"""

from __future__ import annotations

import importlib
import os
import re
import sys
from pathlib import Path

_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_HOME_OF = {name: module for module, name in re.findall(r"^from (\S+) import (\w+) as", _STUB, re.MULTILINE)}
# Of `from streamkit import *`: the names of the stub; but files are still opened by Python's own `open`.
__all__ = sorted(_HOME_OF.keys() - {"open"})  # noqa: PLE0605

if "OPENBLAS_NUM_THREADS" not in os.environ:
    # For NumPy, which reads it when it is imported: its threads would compete with those of the elements.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    if "numpy" in sys.modules:
        from threadpoolctl import threadpool_limits

        threadpool_limits(1, user_api="blas")


def __getattr__(name: str) -> object:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'streamkit' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME_OF})
