"""Kernels run where no cache can be written, are compiled before the first frame, and are never stale."""

import subprocess
import sys
import textwrap
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import types

from streamkit_kernels import UINT8, compiled, kernel, prepare
from streamkit_kernels.compilation import on_compilation

# Prints the kernels of a package that one of its modules imports, then those of all its modules.
KERNELS = """
import importlib, pkgutil, sys
from streamkit_kernels.compilation import _kernels

def show():
    functions = {kernel.py_func for kernel, _ in _kernels}
    names = {f"{each.__module__}.{each.__name__}" for each in functions}
    print(*sorted(name for name in names if name.startswith(package + ".")))

package = sys.argv[1].partition(".")[0]
importlib.import_module(sys.argv[1])
show()
for module in pkgutil.walk_packages(importlib.import_module(package).__path__, package + "."):
    importlib.import_module(module.name)
show()
"""


@kernel(UINT8, types.int64)
def brighten(image: Any, amount: int) -> None:
    """Adds to each pixel, in place."""
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            image[row, column] += amount


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


def test_a_prepared_kernel_takes_its_own_types_alone() -> None:
    """Others would be compiled in mid-stream."""
    prepare(__name__.partition(".")[0])
    image = np.zeros((2, 3), np.uint8)
    brighten(image, 7)
    prepare(__name__.partition(".")[0])
    assert image.tolist() == [[7, 7, 7], [7, 7, 7]]
    with pytest.raises(TypeError, match="No matching definition"):
        brighten(np.zeros((2, 3), np.float32), 7)


def test_a_package_is_prepared_alone() -> None:
    """Kernels of others are not compiled for it."""

    @kernel(UINT8)
    def untouched(image: Any) -> None:
        image[0, 0] = 0

    began: list[bool] = []
    with on_compilation(lambda: began.append(True)):
        prepare("no_such_package")
    assert not began


def outputs(folder: Path, module: str) -> list[str]:
    """What two processes print that import a module of a folder, one after the other."""
    return [
        subprocess.run(
            [sys.executable, "-c", f"import {module}"],
            cwd=folder, check=True, capture_output=True, text=True, timeout=60,
        ).stdout
        for _ in range(2)
    ]  # fmt: skip


def test_the_wait_is_reported_where_there_is_one(tmp_path: Path) -> None:
    """Once, by the process that compiles; those that find the machine code do not import the compiler."""
    (tmp_path / "loops_of_a_test.py").write_text(
        textwrap.dedent("""
        import sys

        from streamkit_kernels import UINT8, kernel, start_kernels, prepare

        @kernel(UINT8)
        def first(image):
            image[0, 0] = 1

        @kernel(UINT8)
        def second(image):
            image[0, 0] = 2

        start_kernels(__name__, lambda: prepare(__name__), is_live=True, report=print)
        print("compiler is", "loaded" if "numba.np.linalg" in sys.modules else "left out")
        """)
    )
    said = outputs(tmp_path, "loops_of_a_test")
    warning, loaded = said[0].splitlines()
    assert "`streamkit prepare` does it beforehand" in warning
    assert (loaded, said[1]) == ("compiler is loaded", "compiler is left out\n")


def test_kernels_of_a_file_are_loaded_with_their_first_call(tmp_path: Path) -> None:
    """Once machine code of all is there; before, they are all compiled at the start."""
    (tmp_path / "loops_of_a_file.py").write_text(
        textwrap.dedent("""
        import numpy as np

        from streamkit_kernels import UINT8, kernel, prepare, start_kernels

        @kernel(UINT8)
        def first(image):
            image[0, 0] = 1

        @kernel(UINT8)
        def second(image):
            image[0, 0] = 2

        def warm_up():
            print("warm")
            prepare(__name__)

        start_kernels(__name__, warm_up, is_live=False, report=lambda text: print("compiles"))
        image = np.zeros((1, 1), np.uint8)
        first(image)
        print(image[0, 0])
        try:
            first(image.astype(np.float32))
        except TypeError:
            print("refused")
        """)
    )
    said = [output.split() for output in outputs(tmp_path, "loops_of_a_file")]
    assert said == [["warm", "compiles", "1", "refused"], ["1", "refused"]]


def test_a_change_in_another_module_of_the_package_invalidates_the_machine_code(tmp_path: Path) -> None:
    """A kernel uses another module's compiled function, and that function the constant of a third module."""
    package = tmp_path / "loops_of_a_package"
    (package / "parts").mkdir(parents=True)
    for folder in (package, package / "parts"):
        (folder / "__init__.py").write_text("")
    (package / "parts" / "steps.py").write_text(
        textwrap.dedent("""
        from loops_of_a_package.constants import AMOUNT
        from streamkit_kernels import compiled

        @compiled
        def step(image):
            image[0, 0] += AMOUNT
        """)
    )
    (package / "kernels.py").write_text(
        textwrap.dedent("""
        from loops_of_a_package.parts.steps import step
        from streamkit_kernels import UINT8, kernel

        @kernel(UINT8)
        def brighten(image):
            step(image)
        """)
    )
    program = textwrap.dedent("""
        import numpy as np
        from loops_of_a_package.kernels import brighten
        from streamkit_kernels import prepare
        from streamkit_kernels.compilation import on_compilation

        with on_compilation(lambda: print("compiles")):
            prepare("loops_of_a_package")
        image = np.zeros((1, 1), np.uint8)
        brighten(image)
        print(image[0, 0])
    """)
    said = []
    for amount in (1, 1, 2):
        (package / "constants.py").write_text(f"AMOUNT = {amount}\n")
        # -B: files of bytecode are checked by a time in whole seconds.
        done = subprocess.run(
            [sys.executable, "-B", "-c", program],
            cwd=tmp_path, check=True, capture_output=True, text=True, timeout=60,
        )  # fmt: skip
        said.append(done.stdout.split())
    assert said == [["compiles", "1"], ["1"], ["compiles", "2"]]


@pytest.mark.parametrize("entry", entry_points(group="streamkit.preparations"), ids=lambda entry: entry.name)
def test_a_preparation_knows_all_kernels_of_its_package(entry: EntryPoint) -> None:
    """`streamkit prepare` imports no more than the module it is sent to: a kernel elsewhere would be left."""
    found = subprocess.run(
        [sys.executable, "-c", KERNELS, entry.module], capture_output=True, text=True, check=True, timeout=60
    )
    prepared, all_kernels = found.stdout.splitlines()
    assert prepared == all_kernels
    assert "." in prepared
