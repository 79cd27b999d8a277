"""`streamkit graph --stats`: the counters of a run in the drawing."""

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from streamkit import Pipeline
from streamkit.cli.main import make_app
from streamkit.cli.summary import to_json
from streamkit.flow.statistics import RunStatistics

TEXT = "fakesrc num-buffers=40 ! queue name=q ! identity name=half drop-probability=1 ! fakesink"


def graph(*arguments: str) -> Result:
    """Runs the command in this process."""
    return CliRunner().invoke(make_app(), ["graph", *arguments])


@pytest.fixture
def statistics(tmp_path: Path) -> Path:
    """A file with the counters of a run of two seconds."""
    with Pipeline.parse(TEXT) as pipeline:
        pipeline.run(timeout_s=20)
        found = RunStatistics(elapsed_s=2.0, elements=pipeline.statistics())
    file = tmp_path / "statistics.json"
    file.write_text(to_json(found), encoding="utf-8")
    return file


def test_mermaid_has_rates_and_drops_on_links_and_work_on_elements(statistics: Path) -> None:
    """Frames and rate on each link, drops on the link into the element that dropped them."""
    lines = graph("--stats", str(statistics), TEXT).stdout.splitlines()
    assert any(
        re.fullmatch(r'  n0\["fakesrc0<br>num-buffers=40<br>busy \d+%<br>age \d+ m?s"\]', line)
        for line in lines
    )
    assert any(re.fullmatch(r'  n1\["q<br>queue 0/200 \(\d+\)<br>age \d+ m?s"\]', line) for line in lines)
    assert '  n0 -- "ANY<br>40 frames, 20.0/s" --> n1' in lines
    into_identity = next(line for line in lines if line.startswith("  n1 -- "))
    assert re.search(r"40 frames, 20\.0/s<br>dropped 40 \(drop-probability\)", into_identity)
    assert '  n2 -- "ANY<br>0 frames, 0.0/s" --> n3' in lines
    assert sum(line.startswith("  style n") for line in lines) == 4


def test_dot_has_counters_and_load_colours(statistics: Path) -> None:
    """The colour depends on the load."""
    dot = graph("--format", "dot", "--stats", str(statistics), TEXT).stdout
    assert '"fakesrc0" -> "q" [label="ANY\\n40 frames, 20.0/s"];' in dot
    assert re.search(
        r'"half" \[label="half\\ndrop-probability=1.*", style=filled, fillcolor="#ff[0-9a-f]{4}"\];', dot
    )


def test_elements_without_counters_are_drawn_plain(statistics: Path) -> None:
    """The description may have elements that the run did not have."""
    lines = graph("--stats", str(statistics), TEXT + " fakesrc name=new ! fakesink").stdout.splitlines()
    assert '  n4["new"]' in lines


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "error: cannot read the statistics {}: No such file or directory"),
        ("{", "error: {}: no statistics as launch --stats-file writes them: "),
        (
            '{"elapsed_s": "x", "elements": []}',
            "error: {}: no statistics as launch --stats-file writes them: ",
        ),
        (json.dumps({"schema": "other/1", "elapsed_s": 1, "elements": []}), "error: {}: no statistics as"),
        (
            json.dumps({"elapsed_s": 1, "elements": []}),
            "error: {}: none of its elements is in this description",
        ),
    ],
)
def test_an_invalid_statistics_file_is_code_2(tmp_path: Path, content: str | None, message: str) -> None:
    """The message says what is wrong."""
    file = tmp_path / "odd.json"
    if content is not None:
        file.write_text(content, encoding="utf-8")
    done = graph("--stats", str(file), TEXT)
    assert done.exit_code == 2
    assert done.stderr.startswith(message.format(file))


@pytest.mark.parametrize("form", ["mermaid", "dot"])
def test_a_link_with_many_formats_shows_the_first_ones(form: str) -> None:
    """One to a line; json has all of them."""
    text = "filesrc ! decode ! fakesink"
    drawn = graph("--format", form, text).stdout
    assert re.search(r"video/x-h264(<br>|\\n)video/x-h265\1.*\1\.\.\. and \d+ more", drawn)
    assert "video/x-vp9" not in drawn
    assert "video/x-vp9" in graph("--format", "json", text).stdout
