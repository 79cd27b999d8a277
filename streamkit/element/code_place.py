"""Where in an element's code an exception was raised."""

from __future__ import annotations

import inspect
import traceback
from pathlib import Path


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


def traceback_of(error: BaseException) -> str:
    """The traceback of an exception, without that of its cause."""
    return "".join(traceback.format_exception(error, chain=False)).rstrip()
