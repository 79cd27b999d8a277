import json
from pathlib import Path

from streamkit import Pipeline


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
