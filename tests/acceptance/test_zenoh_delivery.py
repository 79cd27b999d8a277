"""Tracks reach another process over zenoh: none lost, none changed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

BINARY = Path(sys.executable).with_name("streamkit")
FRAMES = 50
TIMES = ("published_ns", "age_ms", "source", "dropped")


def without_times(line: str) -> dict[str, Any]:
    """A record without the fields that differ between two publishers of the same frame."""
    return {name: value for name, value in json.loads(line).items() if name not in TIMES}


def test_subscriber_in_another_process_gets_every_record(tmp_path: Path) -> None:
    """`streamkit subscribe` prints one record per frame, with the same tracks that tracksink wrote."""
    key, written = f"test/{tmp_path.name}", tmp_path / "tracks.jsonl"
    with subprocess.Popen(
        [str(BINARY), "subscribe", key, "--format", "jsonl", "--timeout", "60"],
        stdout=subprocess.PIPE,
        text=True,
    ) as subscriber:
        try:
            launched = subprocess.run(
                [
                    str(BINARY),
                    "launch",
                    f"dronetestsrc num-buffers={FRAMES} seed=1 ! video/x-raw, width=640, height=480 "
                    "! stitch ! framediff ! particletrack ! tee name=t "
                    f"t. ! queue ! zenohsink key={key} wait-subscribers=1 "
                    f"t. ! queue ! tracksink location={written} provenance=false",
                ],
                timeout=80,
                capture_output=True,
                text=True,
                check=False,
            )
            assert launched.returncode == 0, launched.stderr
            received = subscriber.communicate(timeout=30)[0].splitlines()
        finally:
            subscriber.kill()
    assert subscriber.returncode == 0
    wanted = [without_times(line) for line in written.read_text(encoding="utf-8").splitlines()]
    assert len(wanted) == FRAMES
    assert [without_times(line) for line in received] == wanted
    assert any(track["state"] == "confirmed" for record in wanted for track in record["tracks"])
