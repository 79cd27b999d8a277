"""The table of feeds."""

from pathlib import Path

import pytest

from streamkit import ResourceError
from streamkit_fleet.feeds import FeedSpec, by_process, read_feeds, resolve

TABLE = """
[defaults]
file = "camera.pipe"
cores = 0.5
set = { pattern = "smpte", rate = 25 }

[feeds.gate]
set = { pattern = "snow" }
secrets = { name = "env:GATE_NAME" }

[feeds.roof]
text = "fakesrc ! fakesink"
tags = ["site-a"]
"""


def write(folder: Path, table: str) -> Path:
    """The table and the description that it names."""
    (folder / "camera.pipe").write_text("videotestsrc pattern=${pattern} name=${name:-x} ! fakesink")
    path = folder / "fleet.toml"
    path.write_text(table)
    return path


def test_a_feed_has_the_defaults_and_its_own(tmp_path: Path) -> None:
    """Variables are merged one by one, text takes the place of a file, and a file is read at once."""
    feeds = read_feeds(write(tmp_path, TABLE))
    gate, roof = feeds["gate"], feeds["roof"]
    assert gate.set == {"pattern": "snow", "rate": 25}
    assert (gate.file, gate.text[:12], gate.cores) == ("", "videotestsrc", 0.5)
    assert roof.text == "fakesrc ! fakesink"
    assert (roof.set["pattern"], roof.tags) == ("smpte", ["site-a"])


def test_a_digest_changes_with_the_feed_and_its_description(tmp_path: Path) -> None:
    """Other processes keep theirs."""
    before = by_process(read_feeds(write(tmp_path, TABLE)))
    path = write(tmp_path, TABLE.replace("snow", "ball"))
    after = by_process(read_feeds(path))
    changed = {process for process in before if before[process].digest != after[process].digest}
    assert changed == {"feed:gate"}


def test_feeds_of_one_process_are_together(tmp_path: Path) -> None:
    """A process may have the name of a feed that has one of its own."""
    table = TABLE + "\n[feeds.yard]\nprocess = 'gate'\n[feeds.door]\nprocess = 'gate'\n"
    found = by_process(read_feeds(write(tmp_path, table)))
    assert {name: list(process.feeds) for name, process in found.items()} == {
        "feed:gate": ["gate"],
        "feed:roof": ["roof"],
        "process:gate": ["yard", "door"],
    }


@pytest.mark.parametrize(("key", "value"), [("nice", 3), ("tags", ["site-b"]), ("max_restarts", 2)])
def test_a_process_has_what_its_feeds_agree_on(key: str, value: object) -> None:
    """Also where the table was made by a program: none of its feeds decides for the others."""
    one, other = FeedSpec(process="p"), FeedSpec(process="p", **{key: value})
    with pytest.raises(ResourceError, match=f"^feeds of process p must have the same {key}$"):
        by_process({"a": one, "b": other})
    (process,) = by_process({"a": other, "b": other}).values()
    assert (process.name, getattr(process, key)) == ("process:p", value)


def test_secrets_are_read_where_the_feed_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the environment or a file; a missing one is named by its reference."""
    (tmp_path / "token").write_text("from-file\n")
    monkeypatch.setenv("GATE_NAME", "from-environment")
    feed = FeedSpec(set={"n": 1}, secrets={"a": "env:GATE_NAME", "b": f"file:{tmp_path / 'token'}"})
    assert feed.variables() == {"n": "1", "a": "from-environment", "b": "from-file"}
    with pytest.raises(ResourceError, match="secret env:NOTHING is not there"):
        resolve("env:NOTHING")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("", "has no feed"),
        ("[other]\n[feeds.a]", r"\[defaults\] and \[feeds.NAME\] only, got 'other'"),
        ("[feeds.a]\ntext='fakesrc ! nothing'", "feed a: .*nothing"),
        (
            "[feeds.a]\ntext='${A:-fakesrc} ! ${B}'",
            r"feed a: variable 'B' has no .*; write set = \{ B = \"VALUE",
        ),
        ("[feeds.a]\ncolour=1", "feed a: .*colour"),
        ("[feeds.a]\nfile='gone.pipe'", "feed a: cannot read .*gone.pipe: No such file"),
        ("[feeds.a]\nfile='.'", "feed a: cannot read .*: Is a directory"),
        ("[feeds.a]\ntext='fakesrc ! fakesink'\nnice=-1", "feed a: .*nice"),
        ("[feeds.a]\ntext='fakesrc ! fakesink'\nsecrets={p='hunter2'}", "a secret is a reference"),
        ("[feeds.a]\ncores=1", "feed a: it has no description; write file= or text="),
        ("[feeds", "cannot read the feeds"),
        ("feeds=3", "has no feed"),
        ("feeds=[1]", "has no feed"),
        ("[feeds]\na=5", r"feeds.a must be a table; write \[feeds.a\] and a line for each key"),
        ("[feeds.a]\nset='x'", "feeds.a.set must be a table"),
        ("[defaults]\nsecrets=3\n[feeds.a]", "defaults.secrets must be a table"),
        ("defaults=3\n[feeds.a]", "defaults must be a table"),
        ("[feeds.a]\ntext='fakesrc ! fakesink'\ncores=-1", "feed a: Expected `float` >= 0.0.*cores"),
        ("[feeds.a]\ntext='fakesrc ! fakesink'\ngpus=inf", "feed a: Expected `float` <= .*gpus"),
        ("[feeds.a]\ntext='fakesrc ! fakesink'\ncores=nan", "feed a: Expected `float` >= 0.0.*cores"),
        (
            "[feeds.a]\ntext='fakesrc ! fakesink'\nframe_rate=-1",
            "feed a: Expected `float` >= 0.0.*frame_rate",
        ),
        (
            "[feeds.a]\ntext='fakesrc ! fakesink'\ntags=['GPU']",
            "GPU is no tag of a machine; write cores, gpus",
        ),
        (
            "[defaults]\ntext='fakesrc ! fakesink'\nprocess='p'\n[feeds.a]\n[feeds.b]\nnice=3",
            "feeds of process p must have the same nice",
        ),
    ],
)
def test_a_bad_table_is_refused(tmp_path: Path, table: str, message: str) -> None:
    """The error names the file, the feed and the rule, and never a value given as a secret."""
    with pytest.raises(ResourceError, match=message) as failure:
        read_feeds(write(tmp_path, table))
    assert "hunter2" not in str(failure.value)
