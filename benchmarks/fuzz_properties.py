"""Hostile values for every property of every element, by text and by `set_property`, then a short run.

A value is taken or refused with a PropertyError or DescriptionError; a run ends in EOS or in a failure whose
cause is streamkit's own, the operating system's, or a ValueError. Paths are kept inside a temporary folder,
and elements of the network are not run.

Run it:  python benchmarks/fuzz_properties.py [--minutes 10]
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import fuzz_watch

TEXTS = (
    "", " ", "0", "-1", "1", "2", "7", "0.5", "-0.0", "1e-300", "1e300", "1e400", "nan", "inf", "-inf",
    "0x10", "1/0", "0/1", "1/3", "-5/7", "99999999999999999999", "2147483647", "2147483648", "4294967296",
    "9223372036854775807", "18446744073709551615", "true", "false", "yes", "NULL", "None", "none", "a b",
    "a,b", "1,2", "0,0,0,0", "1,2,3,4", "-1,-1,1e9,1e9", "nan,nan,nan,nan", "%d", "%s%s", "%05d.jpg",
    "%99999d", "x.mp4", "x.ts", "x.mkv", "x.jsonl", "x.npz", "x.csv", "x/y/z.mp4", "\\", "'", "((",
    "[1,2]", "{a}", "{", "a/b", "video/x-raw", "video/x-raw,width=0", "ANY", "EMPTY", "rtsp://u:p@h/x",
    "rtsp://h:99999/", "udp://:0", "tcp/1.2.3.4:5", "tls/h:1#k=v", "**", "a/**/b", "\u00e9\u00df",
    "\U0001f600", "\u202e", "\ud800", "\0", "a\nb", "A" * 5000, "db2", "haar", "all", "auto",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    *TEXTS, None, True, False, 0, 1, -1, 3, 2**31, 2**63, 2**64, -(2**63), 10**400, 0.0, -0.5, 0.25,
    1e-300, 1e300, math.nan, math.inf, -math.inf, Fraction(1, 3), Fraction(30), b"x", (), [1], {},
    object(), int, "5" * 4000,
)  # fmt: skip
NETWORK = {"rtspsrc", "livesrc", "rtspclientsink", "zenohsink", "zenohsrc", "cotsink"}
VIDEO = "videotestsrc num-buffers=3 ! video/x-raw, width=64, height=48"
CODED = {"packetsink", "remux", "decode"}
RUN_S = 1.0
SETTLED = 1500  # each property has been set about three times


def kept_inside(value: Any) -> Any:
    """A text that, should it be a path, stays in the current folder."""
    if not isinstance(value, str):
        return value
    return re.sub(r"(?i)file:/*", "", value).replace("..", "__").lstrip("/~ ")


def make_case() -> fuzz_watch.Case:
    """The function that gives each case."""
    from streamkit.element.registry import available_elements, element_class

    pairs = [
        (factory, name)
        for factory in available_elements()
        for name, item in element_class(factory).properties.items()
        if not item.readonly
    ]

    def case(number: int) -> tuple[str, Callable[[], str]]:
        chance = random.Random(number)
        factory, name = pairs[number % len(pairs)] if number < len(pairs) else chance.choice(pairs)
        by_text = chance.random() < 0.5
        value = kept_inside(chance.choice(TEXTS if by_text else VALUES))
        text = f"{factory} {name}={value!r:.200} {'by text' if by_text else 'by set_property'}"
        return text, lambda: play(factory, name, value, by_text=by_text)

    return case


def description(factory: str, assignment: str) -> str:
    """A short pipeline with the element in it."""
    from streamkit.element.registry import element_class

    known = element_class(factory)
    directions = {str(template.direction) for template in known.pad_templates.values()}
    ends = "num-buffers=3 " if "num_buffers" in known.properties else ""
    text = f"{factory} name=fuzzed {ends}{assignment}"
    if "sink" in directions:
        text = f"{VIDEO}{' ! encode' if factory in CODED else ''} ! {text}"
    return f"{text} ! fakesink" if "src" in directions else text


def play(factory: str, name: str, value: Any, *, by_text: bool) -> str:
    """Sets the property, and runs the pipeline where that has no effect outside."""
    from streamkit import DescriptionError, Pipeline, PropertyError

    assignment = ""
    if by_text:
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        assignment = f'{name.replace("_", "-")}="{escaped}"'
    try:
        pipeline = Pipeline.parse(description(factory, assignment))
    except DescriptionError as error:
        return f"refused {error.code}"
    if not by_text:
        try:
            pipeline["fuzzed"].set_property(name, value)
        except PropertyError:
            return "refused value"
    pipeline["fuzzed"].properties_set()
    # An address is waited for as long as its own limit says.
    return "set" if factory in NETWORK else run(pipeline)


def run(pipeline: Any) -> str:
    """Plays for a second at most."""
    from streamkit import ElementFailure, StreamkitError

    try:
        with pipeline:
            pipeline.play()
            message = pipeline.wait(RUN_S)
            error = message.error if message is not None else None
    except StreamkitError as failure:
        error = failure
    if error is None:
        return "ran"
    cause = error.cause if isinstance(error, ElementFailure) else error
    if "has not come back" in str(error):
        return f"odd: {error}"
    if isinstance(cause, StreamkitError | OSError | MemoryError | ValueError):
        return "failed"
    return f"odd: {type(cause).__name__}: {error}"


if __name__ == "__main__":
    fuzz_watch.main(__file__, make_case, SETTLED)
