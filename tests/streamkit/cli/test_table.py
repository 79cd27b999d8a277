"""The tables of --stats."""

import io

from rich.console import Console

from streamkit import Pipeline
from streamkit.cli.display import Display
from streamkit.cli.summary import COLUMNS, HEADS, as_tables


def test_every_column_is_seen_on_a_narrow_terminal() -> None:
    """Long names and reasons fold; the columns behind them stay, and age has its unit."""
    text = "fakesrc num-buffers=3 ! identity drop-probability=1 ! queue name=longer_than_a_column ! fakesink"
    with Pipeline.parse(text) as pipeline:
        display = Display(pipeline)
        display.begin()
        pipeline.run()
        statistics = display.measure()
    out = io.StringIO()
    Console(file=out, width=72).print(as_tables(statistics))
    lines = out.getvalue().splitlines()
    head = next(line for line in lines if "element" in line)
    assert head.split() == " ".join(HEADS.get(name, name) for name in COLUMNS).split()
    source = next(line for line in lines if "fakesrc0" in line)
    assert source.rstrip().endswith(" ms")
    assert max(map(len, lines)) <= 72
