"""Subscribers without streamkit decode its records in every encoding, and the example works."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from streamkit import (
    Capture,
    Frame,
    Registration,
    Track,
    Tracks,
    TrackState,
    encode_record,
    raw_video_caps,
    track_record,
)
from streamkit.testing import Harness
from tests.ports import free_port

FOREIGN = Path(__file__).with_name("zenoh_foreign_subscriber.py")
EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "zenoh" / "subscribe.py"
COUNT = 5


def _frame(seq: int) -> Frame:
    generator = np.random.default_rng(seq)
    tracks = tuple(
        Track(
            number + 1, state, *generator.normal(300, 90, 4), float(generator.normal()),
            tuple(generator.normal(0, 20, 2)), generator.normal(size=(2, 2)), 0.87, 3_120_000_000,
        )
        for number, state in enumerate((TrackState.CONFIRMED, TrackState.COASTING))
    )  # fmt: skip
    frame = Frame(
        np.zeros((4, 8), np.uint8), raw_video_caps("GRAY8", 8, 4), pts=seq * 40_000_000, seq=seq, epoch=1,
        arrival_ns=1, capture=Capture(1_763_690_000_123_456_789, "rtcp"),
    )  # fmt: skip
    return frame.attach(Tracks(tracks), Registration(np.eye(3), generator.normal(size=(3, 3)), reference=-3))


def _run(script: Path, encoding: str, ready: str = "") -> list[str]:
    """The output of a script while five frames are published, the first once it has printed `ready`."""
    key, endpoint = "acceptance/foreign", f"tcp/127.0.0.1:{free_port()}"
    with Harness("zenohsink", key=key, listen=endpoint, encoding=encoding, wait_subscribers=1) as harness:
        process = subprocess.Popen(
            [sys.executable, str(script), key, endpoint, str(COUNT)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert process.stdout is not None
        try:
            lines = [process.stdout.readline().rstrip()] if ready else []
            assert lines in ([], [ready])
            for seq in range(COUNT):
                harness.push(_frame(seq))
            out, err = process.communicate(timeout=40)
        finally:
            process.kill()
            process.wait(10)
        harness.drain()
    assert process.returncode == 0, err
    return [*lines, *out.splitlines()]


@pytest.mark.parametrize("encoding", ["json", "msgpack", "cbor", "protobuf"])
def test_the_schema_is_enough(encoding: str) -> None:
    """Decoded by the schema alone, every field of every record is exact."""
    found = [json.loads(line) for line in _run(FOREIGN, encoding)]
    for seq, record in enumerate(found):
        wanted = json.loads(
            encode_record(track_record(_frame(seq), source="acceptance/foreign", published_ns=1))
        )
        for changing in ("published_ns", "age_ms"):
            assert record.pop(changing) > 0
            wanted.pop(changing)
        assert record == wanted
    assert len(found) == COUNT


def test_no_streamkit_is_imported() -> None:
    """The foreign subscriber and the example import only zenoh and decoders."""
    for script in (FOREIGN, EXAMPLE):
        assert "import streamkit" not in script.read_text(encoding="utf-8")
        assert "from streamkit" not in script.read_text(encoding="utf-8")


def test_the_example_of_the_documentation_works() -> None:
    """It says that the publisher is there, and prints a line per record."""
    lines = _run(EXAMPLE, "json", ready="publisher there")
    records = [line.split() for line in lines if line.startswith("record")]
    assert [int(words[1]) for words in records] == list(range(COUNT))
    assert all(words[2] == "#1" for words in records)
