"""Where in an element's code an exception was raised."""

from __future__ import annotations

import importlib
import inspect
import traceback
from pathlib import Path

ENGINE = {Path(__file__).parents[1], Path(importlib.__file__).parent}  # the folders of what imports plugins


def place_of(error: BaseException, owner: type) -> str:
    """File and line where an exception left the code of a class, as "file.py:12".

    The engine refuses what an element has returned: then the file and class, as "file.py, class Blur".
    """
    file = Path(inspect.getfile(owner))
    frames: list[traceback.FrameSummary] = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if file.parent in Path(frame.filename).parents]
    if not own:
        return f"{file.name}, class {owner.__name__}"
    return f"{Path(own[-1].filename).name}:{own[-1].lineno}"


def place_in_plugin(error: BaseException) -> str:
    """File and line where an exception left the code of a plugin, as "/path/blur.py:12"; "" if there is none.

    For a module that fails while it is imported: there is no class yet, and its first frame tells the folder.
    """
    frames: list[traceback.FrameSummary] = traceback.extract_tb(error.__traceback__)
    others = [frame for frame in frames if not _is_engine(frame.filename)]
    if not others:
        return ""
    folder = Path(others[0].filename).parent
    own = [frame for frame in others if folder in Path(frame.filename).parents]
    return f"{own[-1].filename}:{own[-1].lineno}"


def _is_engine(filename: str) -> bool:
    is_frozen = filename.startswith("<")  # such as "<frozen importlib._bootstrap>"
    return is_frozen or not ENGINE.isdisjoint(Path(filename).parents)


def traceback_of(error: BaseException) -> str:
    """The traceback of an exception, without that of its cause."""
    return "".join(traceback.format_exception(error, chain=False)).rstrip()
