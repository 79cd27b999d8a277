"""Compiled loops run wherever Python does."""

import textwrap
from typing import Any

import numpy as np
import pytest
from numba import types

from streamkit_stitcher import compiled as room
from streamkit_stitcher.compiled import compiled, kernel, prepare


def test_code_without_a_file_is_compiled_anew() -> None:
    """Where numba finds no folder to keep machine code in, the loop is compiled in each process."""
    names: dict[str, Any] = {}
    source = """
        def doubled(values):
            for index in range(values.size):
                values[index] *= 2
    """
    exec(textwrap.dedent(source), names)
    values = np.arange(4)
    compiled(names["doubled"])(values)
    assert values.tolist() == [0, 2, 4, 6]


@pytest.fixture
def own_kernels(monkeypatch):
    """No other kernels than the test's."""
    monkeypatch.setattr(room, "_kernels", [])


@pytest.mark.usefixtures("own_kernels")
def test_what_is_prepared_is_never_compiled_again() -> None:
    """A call with the types that were declared runs at once, one with others is refused."""
    names: dict[str, Any] = {}
    exec("def total(values):\n    return values.sum()", names)
    total = kernel(types.Array(types.float64, 1, "C", readonly=True))(names["total"])
    prepare()
    prepare()
    values = np.arange(4.0)
    assert total(values) == 6.0
    values.flags.writeable = False
    assert total(values) == 6.0
    with pytest.raises(TypeError, match="No matching definition"):
        total(np.arange(4, dtype=np.uint8))
