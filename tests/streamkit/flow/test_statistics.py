"""The counters of a run, from their file."""

from pathlib import Path

import pytest

from streamkit import RunStatistics, StreamError, read_statistics


def test_a_file_is_named_by_a_text_or_a_path(tmp_path: Path) -> None:
    """As for `read_tracks`."""
    file = tmp_path / "run.json"
    file.write_text('{"schema": "streamkit.statistics/1", "elapsed_s": 2.0, "elements": []}')
    assert read_statistics(str(file)) == read_statistics(file) == RunStatistics(elapsed_s=2.0, elements=[])
    file.write_text("id,x\n")
    with pytest.raises(StreamError, match=r"run\.json: no statistics as launch --stats-file writes them"):
        read_statistics(str(file))
