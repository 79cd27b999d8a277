"""Random and mutated descriptions: each becomes a graph or one DescriptionError that points into the text.

Run it:  STREAMKIT_DATA=... python benchmarks/fuzz_descriptions.py [--minutes 10]
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
from collections.abc import Callable
from pathlib import Path

import fuzz_watch

PIPELINES = Path(__file__).resolve().parents[1] / "pipelines"
WORDS = re.compile(r"\s+|[!:.(),=]|[^\s!:.(),=]+")
PIECES = (
    "!", ":", ".", "(", ")", ",", ";", "=", "\"", "'", "\\", "@", "#", "${", "}", "${X:-y}", "::", "://",
    "\n", "\0", "bin.(", "name=a", "a.", "a.src", "t.sink_0", "tee name=t", "queue",
    "fakesrc num-buffers=1", "fakesink", "videotestsrc", "video/x-raw,width=[1,max]",
    "video/x-raw(memory:X)", "caps=\"a/b, x=(int){1,2}\"", "@preset=x", "file:///x", "rtsp://u:p@h/x",
    "name=\"\\\"\"", "-1", "1e400", "NULL", "\u00e9", "\ud83d\ude00", "\u202e",
)  # fmt: skip
SETTLED = 500  # most plugins have been imported
LONGEST = 1_100_000  # a little more than is taken
LENGTHS = (1, 1, 1, 2, 3, 8, 40)


def seeds() -> list[str]:
    """The descriptions of the conformance cases, and the ready pipelines."""
    cases = Path(os.environ["STREAMKIT_DATA"]) / "conformance" / "cases.jsonl"
    rows = [json.loads(line) for line in cases.read_text(encoding="utf-8").splitlines()]
    found = [row["description"] for row in rows if row.get("description")]
    return found + [path.read_text(encoding="utf-8") for path in sorted(PIPELINES.glob("*.pipe"))]


def mutated(text: str, other: str, chance: random.Random) -> str:
    """A variant: words taken out, doubled, swapped, put in, joined with another text, or changed."""
    words = WORDS.findall(text) or [""]
    for _ in range(chance.choice(LENGTHS)):
        at, kind = chance.randrange(len(words)), chance.randrange(8)
        if kind == 0 and len(words) > 1:
            del words[at]
        elif kind == 1:
            words[at:at] = words[at : at + chance.randrange(1, 9)] * chance.choice((1, 1, 2, 100))
        elif kind == 2:
            to = chance.randrange(len(words))
            words[at], words[to] = words[to], words[at]
        elif kind <= 4:
            words.insert(at, chance.choice(PIECES))
        elif kind == 5:
            words[at] = (words[at] * chance.choice((2, 50, 3000)))[:LONGEST]
        elif kind == 6:
            rest = WORDS.findall(other) or [""]
            words = words[:at] + rest[chance.randrange(len(rest)) :]
        elif words[at]:
            place = chance.randrange(len(words[at]))
            words[at] = words[at][:place] + chr(chance.randrange(0x250)) + words[at][place + 1 :]
        words = words[:20_000] or [""]
    return "".join(words)[:LONGEST]


def random_text(chance: random.Random) -> str:
    """Pieces of the language without any order."""
    return chance.choice((" ", "", " ! ")).join(chance.choices(PIECES, k=chance.randrange(1, 60)))


def make_case() -> fuzz_watch.Case:
    """The function that gives each case."""
    from streamkit import DescriptionError, Pipeline
    from streamkit.cli.graph import as_json
    from streamkit.graph.negotiate import remembered_caps

    known = seeds()

    def build(text: str) -> str:
        variables = {"location": "x.mp4", "uri": "rtsp://h/x", "key": "k"}
        try:
            pipeline = Pipeline.parse(text, variables)
        except DescriptionError as error:
            shown, lines = error.pointed(text), text.split("\n")
            if not 1 <= error.place.line <= len(lines) or len(shown) > 20_000:
                return f"odd: error {error.code} at line {error.place.line}, {len(shown)} characters"
            return f"refused {error.code}"
        graph = pipeline.graph
        with contextlib.nullcontext() if graph.has_loop() else remembered_caps(graph):
            json.dumps(as_json(graph))
        return "graph"

    def case(number: int) -> tuple[str, Callable[[], str]]:
        chance = random.Random(number)
        text = (
            random_text(chance)
            if number % 4 == 0
            else mutated(chance.choice(known), chance.choice(known), chance)
        )
        return text, lambda: build(text)

    return case


if __name__ == "__main__":
    fuzz_watch.main(__file__, make_case, SETTLED)
