"""Compiled loops run wherever Python does."""

import textwrap
from typing import Any

import numpy as np

from streamkit_tracker.compiled import compiled


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
