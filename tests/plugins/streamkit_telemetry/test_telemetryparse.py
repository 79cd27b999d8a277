import json
from pathlib import Path
from typing import NoReturn

from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit import Caps, Frame, MessageKind, Pipeline
from streamkit.testing import Harness
from streamkit_telemetry.st0601writer import element, local_set_packet

KLV, TEXT = Caps("meta/x-klv, parsed=(boolean)false"), Caps("text/x-raw, format=utf8")
POSITION = b"\x0d\x04\x10\x00\x00\x00\x0e\x04\x10\x00\x00\x00"


def test_klv_becomes_lines(streamkit_data: Path, tmp_path: Path) -> None:
    """Each packet of a real recording is one JSON object with its time and position."""
    location, out = streamkit_data / "telemetry" / "sample-stream.ts", tmp_path / "poses.jsonl"
    text = f"filesrc name=s location={location}  s.klv ! telemetryparse ! filesink location={out}"
    Pipeline.parse(text).run(timeout_s=20)
    rows = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
    assert len(rows) == 277
    assert rows[0]["pts_ns"] == 2_167_000_000
    assert rows[0]["utc_ns"] == 1_340_980_354_100_000_000
    assert abs(rows[0]["latitude"] - 34.7211532) < 1e-6
    assert len(rows[0]["corners"]) == 4
    assert "target" not in rows[0]


def no_constant(name: str) -> NoReturn:
    """JSON has no NaN and no infinity."""
    raise AssertionError(name)


values = st.one_of(st.binary(max_size=10), st.integers(120, 300).map(lambda size: b"\xff" * size))
hostile = st.lists(st.builds(element, st.integers(2, 150), values), max_size=30)


@settings(max_examples=100)
@given(st.lists(hostile, min_size=1, max_size=3))
def test_hostile_packets_with_good_checksums(packets: list[list[bytes]]) -> None:
    """Each packet is a line of JSON, or counted, and the element continues."""
    with Harness("telemetryparse") as harness:
        frames = [
            out
            for elements in packets
            for out in harness.push(Frame(local_set_packet(POSITION + b"".join(elements)), KLV, pts=0))
        ]
        frames += harness.drain()
        message = next(m for m in harness.messages if m.kind is MessageKind.ELEMENT)
    rows = [json.loads(frame.data, parse_constant=no_constant) for frame in frames]
    assert len(rows) == message.fields["poses"]
    assert message.fields["good_packets"] + message.fields["bad_packets"] == len(packets)


def test_broken_subtitles_are_warned_about() -> None:
    """Warnings report how many were left out, and that there is no position."""
    with Harness("telemetryparse") as harness:
        for n in range(3):
            assert harness.push(Frame(b"GPS(1.5,x,16)", TEXT, pts=n)) == []
        harness.drain()
        warnings = [m.text for m in harness.messages if m.kind is MessageKind.WARNING]
    assert warnings[0] == "3 subtitles left out so far: their times or position cannot be read"
    assert warnings[1].startswith("no position in the telemetry: 0 poses")
