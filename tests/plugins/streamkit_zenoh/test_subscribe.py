"""streamkit subscribe: records as lines or a table, the right exit code, and an end within three seconds."""

import contextlib
import json
import os
import pty
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec import structs
from rich.console import Console

from streamkit import Frame, Track, TrackRecord, Tracks, TrackState, raw_video_caps, track_record
from streamkit.flow.record import GeoRecord
from streamkit.testing import Harness
from streamkit_zenoh import silence
from streamkit_zenoh import subscribe as command
from streamkit_zenoh.subscribe_output import Printer, as_table, as_text
from streamkit_zenoh.subscriber import Update
from tests.slowness import patience

BINARY = Path(sys.executable).with_name("streamkit")
PUBLISHER = Path(__file__).with_name("endless_publisher.py")
Starter = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def subscribe(key: str, endpoint: str) -> Iterator[Starter]:
    """Starts `streamkit subscribe`, which listens; killed after the test if it has not ended."""
    processes: list[subprocess.Popen[str]] = []

    def started(*arguments: str, **options: object) -> subprocess.Popen[str]:
        command = [str(BINARY), "subscribe", key, "--listen", endpoint, *arguments]
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
        processes.append(subprocess.Popen(command, text=True, **streams))  # type: ignore[call-overload]
        return processes[-1]

    yield started
    for process in processes:
        process.kill()
        process.communicate(timeout=10)


def _frame(seq: int) -> Frame:
    track = Track(7, TrackState.CONFIRMED, 1.5, 2.5, 30.0, 14.0, 0.1, (1.0, 2.0), np.eye(2), 0.5, 7 * 10**9)
    young = Track(8, TrackState.TENTATIVE, 1.5, 2.5, 30.0, 14.0, 0.1, (1.0, 2.0), np.eye(2), 0.5, 7)
    caps = raw_video_caps("GRAY8", 8, 4)
    frame = Frame(np.zeros((4, 8), np.uint8), caps, pts=seq * 40_000_000, seq=seq, arrival_ns=1)
    return frame.attach(Tracks((track, young)))


def _publish(key: str, endpoint: str, count: int, **properties: object) -> None:
    with Harness("zenohsink", key=key, connect=endpoint, wait_subscribers=1, **properties) as harness:
        for seq in range(count):
            harness.push(_frame(seq))
        harness.drain()


def test_jsonl_is_the_record_whatever_its_encoding(subscribe: Starter, key: str, endpoint: str) -> None:
    """One JSON object per line; with --age its age on arrival; totals at the end on stderr."""
    process = subscribe("--format", "jsonl", "--age", "--gaps", "--timeout", "30")
    _publish(key, endpoint, 20, encoding="protobuf")
    out, err = process.communicate(timeout=20)
    assert process.returncode == 0, err
    records = [json.loads(line) for line in out.splitlines()]
    assert [record["seq"] for record in records] == list(range(20))
    assert all(0 < record["arrival_age_ms"] < 20_000 for record in records)
    assert "received 20, lost 0, overwritten 0, bad 0, restarts 0, interleaved 0, jumps 0" in err
    assert "age on arrival: median" in err


def test_text_is_a_line_per_record_and_target_when_piped(subscribe: Starter, key: str, endpoint: str) -> None:
    """Source, number, time and confirmed targets; the count ends it."""
    process = subscribe("--count", "2", "--timeout", "30")
    _publish(key, endpoint, 3)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 0, err
    target = "  #7 confirmed (1.5, 2.5) 30x14 px"
    heads = [f"{key} seq 0    0.000 s  1 tracks", f"{key} seq 1    0.040 s  1 tracks"]
    assert out.splitlines() == [heads[0], target, heads[1], target]


def test_each_counted_record_stays_on_a_terminal(subscribe: Starter, key: str, endpoint: str) -> None:
    """The table of every record is printed, not only that of the last; the waiting line goes."""
    ours, theirs = pty.openpty()
    try:
        process = subscribe("--count", "3", "--timeout", "30", stdout=theirs)
        os.close(theirs)
        _publish(key, endpoint, 3)
        shown = b""
        with contextlib.suppress(OSError):  # the other side has been closed
            while read := os.read(ours, 4096):
                shown += read
        assert process.wait(20) == 0
    finally:
        os.close(ours)
    assert [f"{key}  seq {seq} ".encode() in shown for seq in range(4)] == [True, True, True, False]
    assert shown.count(b"confirmed") == 3


def test_a_killed_publisher_is_an_error_within_three_seconds(
    subscribe: Starter, key: str, endpoint: str
) -> None:
    """Without the status `ended` the exit code is 1, with the reason."""
    process = subscribe("--format", "jsonl", "--timeout", "60")
    publisher = subprocess.Popen([sys.executable, str(PUBLISHER), key, endpoint])
    try:
        assert process.stdout is not None
        for _ in range(5):
            assert json.loads(process.stdout.readline())["source"] == key
    finally:
        publisher.kill()
        publisher.wait(10)
    killed_s = time.monotonic()
    _, err = process.communicate(timeout=20)
    assert time.monotonic() - killed_s < patience(3.0)
    assert process.returncode == 1
    assert "has gone without ending its stream" in err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_it_within_three_seconds(
    subscribe: Starter, key: str, endpoint: str, number: int
) -> None:
    """Exit code 0, with or without a publisher."""
    process = subscribe("--format", "jsonl", "--stay")
    _publish(key, endpoint, 1)
    assert process.stdout is not None
    assert json.loads(process.stdout.readline())["seq"] == 0
    process.send_signal(number)
    began_s = time.monotonic()
    _, err = process.communicate(timeout=20)
    assert time.monotonic() - began_s < patience(3.0)
    assert (process.returncode, err) == (0, "")


def test_a_terminal_shows_that_there_is_no_publisher(subscribe: Starter) -> None:
    """Before the first record a line replaces the table."""
    ours, theirs = pty.openpty()
    try:
        process = subscribe("--timeout", "1", stdout=theirs)
        os.close(theirs)
        shown = b""
        while b"waiting for a record: no publisher is there yet" not in shown:
            shown += os.read(ours, 4096)
        assert process.wait(20) == 1
    finally:
        os.close(ours)


def test_a_timeout_is_an_error(subscribe: Starter) -> None:
    """--timeout ends with exit code 1, and reports whether there is a publisher."""
    process = subscribe("--timeout", "0.2")
    _, err = process.communicate(timeout=20)
    assert process.returncode == 1
    assert err == (
        "error: no record has come within 0.2 s: no publisher is there; start it, or give both sides "
        "endpoints that meet (--connect, --listen)\n"
    )


def test_a_full_disk_is_reported_once(subscribe: Starter, key: str, endpoint: str) -> None:
    """A record that is not written is an error."""
    with Path("/dev/full").open("w") as full:
        process = subscribe("--format", "jsonl", stdout=full)
        publisher = threading.Thread(target=_publish, args=(key, endpoint, 3))
        publisher.start()
        _, err = process.communicate(timeout=20)
        publisher.join(20)
    assert process.returncode == 1
    assert "a record was not printed: No space left on device; free some space" in err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [(("/uav",), "for example uav/1"), (("uav/1", "--connect", "here"), "PROTOCOL/HOST:PORT")],
)
def test_invalid_arguments_are_an_error(arguments: tuple[str, ...], text: str) -> None:
    """Exit code 2 and a remedy, at once."""
    done = subprocess.run(
        [str(BINARY), "subscribe", *arguments], capture_output=True, text=True, timeout=30, check=False
    )
    assert done.returncode == 2
    assert text in done.stderr


def test_the_table_has_a_row_per_target() -> None:
    """Id, state, position, size, velocity, score and age; lost records in the title."""
    record = track_record(_frame(5), source="uav/1", published_ns=1)
    console = Console(width=120, record=True, file=None, force_terminal=False)
    with console.capture() as captured:
        console.print(as_table(record, 12.34, 3))
    text = captured.get()
    assert "uav/1  seq 5  0.200 s  age 12.3 ms  missed 3" in text
    (row,) = [line for line in text.splitlines() if "confirmed" in line]
    assert row.split() == ["7", "confirmed", "2", "2", "30x14", "1", "2", "0.50", "7"]


def test_the_table_fits_80_columns() -> None:
    """With the largest numbers of a 4K frame and a place on the ground."""
    record = track_record(_frame(5), source="uav/1", published_ns=1)
    target = structs.replace(
        record.tracks[0], id=1234, x=3812.4, y=2077.0, length=131.2, width=114.8, vx=-161.0, vy=-104.2,
        age_ns=3120 * 10**9, geo=GeoRecord(lat=-46.842778, lon=-171.994299, error_m=3.0),
    )  # fmt: skip
    console = Console(width=80, file=None, force_terminal=False)
    with console.capture() as captured:
        console.print(as_table(structs.replace(record, tracks=(target,))))
    words = "1234 confirmed 3812 2077 131x115 -161 -104 0.50 3120 -46.84278 -171.99430"
    assert captured.get().splitlines()[-1].split() == words.split()


def test_a_table_without_targets_is_its_title() -> None:
    """A head over nothing, in widths of its own, would only be noise."""
    record = structs.replace(track_record(_frame(5), source="uav/1", published_ns=1), tracks=())
    console = Console(width=80, file=None, force_terminal=False)
    with console.capture() as captured:
        console.print(as_table(record))
    assert captured.get() == "uav/1  seq 5  0.200 s  0 tracks\n"


def test_no_speed_of_the_table_is_minus_zero() -> None:
    """A speed below half a px/s is 0, whatever its sign."""
    record = track_record(_frame(5), source="uav/1", published_ns=1)
    target = structs.replace(record.tracks[0], vx=-0.4, vy=0.4)
    console = Console(width=80, file=None, force_terminal=False)
    with console.capture() as captured:
        console.print(as_table(structs.replace(record, tracks=(target,))))
    assert captured.get().splitlines()[-1].split()[5:7] == ["0", "0"]


def test_a_record_without_time_as_text() -> None:
    """An unknown time is a question mark, not zero."""
    record = track_record(_frame(5).replace(pts=None), source="uav/1", published_ns=1)
    assert as_text(record).startswith("uav/1 seq 5        ? s  1 tracks")


class _Returning:
    """A subscriber whose publisher is gone for a while, or for good."""

    has_vanished = True
    published_keys = list

    def __init__(self, looks: int) -> None:
        self._looks = looks
        self.record = track_record(_frame(5), source="a", published_ns=1)

    @property
    def is_over(self) -> bool:
        return self._looks > 0

    def update(self, _: float) -> Update | None:
        self._looks -= 1
        return None if self.is_over else Update("a/tracks", self.record)


@pytest.mark.parametrize(("looks", "code"), [(3, 0), (10**9, 1)])
def test_a_publisher_that_is_back_in_time_is_no_error(
    monkeypatch: pytest.MonkeyPatch, looks: int, code: int
) -> None:
    """As after this process was suspended; else the error says how to wait for the next."""
    monkeypatch.setattr(command, "POLL_S", 0.001)
    monkeypatch.setattr(command, "RETURN_LIMIT_S", 0.05)
    shown: list[TrackRecord] = []
    printer = SimpleNamespace(refresh=lambda: None, show=shown.append)
    found, message = command._print_all(_Returning(looks), printer, 1, None, lambda: False)
    assert found == code
    assert len(shown) == 1 - code
    assert ("--stay waits" in message) is bool(code)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (["uav/2"], "no publisher has this key; others have uav/2"),
        ([f"uav/{n}" for n in range(10)], "others have uav/0, .*, uav/7 and 2 more"),
        ([], "no publisher is there; start it"),
    ],
)
def test_other_publishers_are_named_where_the_key_has_none(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], keys: list[str], words: str
) -> None:
    """Once while it waits, and in the error at the timeout."""
    monkeypatch.setattr(silence, "SILENCE_S", -1.0)
    counts = SimpleNamespace(publishers=0, lost=0, overwritten=0)
    subscriber: Any = SimpleNamespace(
        update=lambda _: None, is_over=False, counts=counts, warnings=list, published_keys=lambda: keys
    )
    printer = Printer(subscriber, lambda *_: "record", gaps=False, age=False)
    looks = iter([False] * 3 + [True])
    assert command._print_all(subscriber, printer, None, None, lambda: next(looks)) == (0, "")
    said = capsys.readouterr().err
    assert len(re.findall(f"note: no record for -1 s: .*{words}\n", said)) == bool(keys)
    assert said.count("note: no record for -1 s, no publisher is there\n") == (not keys)
    code, message = command._print_all(subscriber, printer, None, -1.0, lambda: False)
    assert code == 1
    assert re.search(f"no record has come within -1 s: .*{words}", message)


def test_a_publisher_that_falls_silent_is_noted_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its camera may be gone while it is there; a record ends the silence, and the next is noted again."""
    monkeypatch.setattr(silence, "SILENCE_S", -1.0)
    updates = iter(
        [None, None, Update("a/tracks", track_record(_frame(5), source="a", published_ns=1)), None]
    )
    counts = SimpleNamespace(publishers=1, lost=0, overwritten=0)
    subscriber: Any = SimpleNamespace(
        update=lambda _: next(updates), is_over=False, counts=counts, warnings=list, published_keys=list
    )
    printer = Printer(subscriber, lambda *_: "record", gaps=False, age=False)
    looks = iter([False] * 4 + [True])
    assert command._print_all(subscriber, printer, None, None, lambda: next(looks)) == (0, "")
    note = "note: no record for -1 s, though a publisher is there: has it lost its feed?\n"
    assert capsys.readouterr() == ("record\n", note * 2)
