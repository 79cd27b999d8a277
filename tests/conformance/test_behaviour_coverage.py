"""Every line of behaviour.md is a test, or a departure that the documentation describes."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
LINE = re.compile(r"^- \*\*([a-z0-9-]+)\*\*", re.MULTILINE)


# Lines without a test: where docs/decisions describes the departure, and lines that one row covers together.
DEPARTURES = {
    "`queue` and `appsink` also take lists of buffers": ["q-time-level-list"],
    "queries travel with the data": ["q-query-inband", "q-query-threshold", "q-query-flush", "ask-drain"],
    "a `tee` merges the allocation queries": ["t-alloc"],
    "a `tee` reports its internal links": ["t-links"],
    "an error behind a `queue` travels upstream": ["q-err-up"],
    "the thread that brings EOS to an inactive input": ["is-eos-inactive"],
    "answer queries for duration and position": ["fk-position", "vr-query"],
    "a stream-start event after EOS": ["fk-restart"],
    "`capsfilter` holds back tags": ["cf-events"],
    "three rules decide whether a pad accepts caps": ["nego-accept"],
    "no `max-time` and `max-bytes`": ["ask-limits"],
    "`videorate` outputs the frame of a tick": ["vr-more", "vr-order0", "vr-order", "vr-maxdup"],
    "| `multiqueue` |": [
        "mq-simple", "mq-pads", "mq-named", "mq-order", "mq-notlinked-eos", "mq-sparse", "mq-shutdown",
        "mq-buffering", "mq-defaults",
    ],
    "a STREAM_START message": ["eos-ss"],
    "elements are added to a running bin": ["sk-complete", "bin-linked", "bin-self"],
    "a source is removed while paused": ["sk-live-remove"],
    "elements have states of their own": ["sk-locked", "st-skip"],
    "the pipeline stays PLAYING after an error": ["err-branch"],
    "probes on pads": ["pad-block", "pad-probe"],
    "ghost pads across bins": ["pad-ghost"],
    "seeking while playing": ["sk-flush", "sk-stop", "sk-no", "sk-loop", "src-eos"],
    "position queries around flushes": ["fk-nonreset"],
    "the bus is flushed": ["bus-null"],
}  # fmt: skip


def test_every_departure_is_described() -> None:
    """A row of a table of departures in docs/decisions."""
    pages = (ROOT / "docs" / "decisions").glob("*.md")
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    assert [row for row in DEPARTURES if row not in text] == []


def test_every_behaviour_is_tested_or_a_departure(shared_folder: Path) -> None:
    """The line's name stands in a test's docstring or among the departures."""
    names = LINE.findall((shared_folder / "conformance" / "behaviour.md").read_text(encoding="utf-8"))
    assert len(names) > 150
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")]
    named = set(re.findall(r"(?<![\w-])[a-z]+[0-9]*(?:-[a-z0-9]+)+(?![\w-])", "\n".join(texts)))
    assert [name for name in names if name not in named] == []
