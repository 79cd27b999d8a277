"""`streamkit launch` on a terminal: progress, table, and Ctrl-C once and twice."""

import fcntl
import json
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

BINARY = str(Path(sys.executable).with_name("streamkit"))
CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
TAKE_TERMINAL = ["/bin/sh", "-c", 'exec "$0" "$@" <"$TERMINAL"']  # whose Ctrl-C is then this session's
NO_VARIABLES: Mapping[str, str] = MappingProxyType({})
LIMIT_S = 60
SLOW = "videotestsrc num-buffers=66 ! video/x-raw,framerate=30/1 ! queue ! fakesink sync=true"
ENDLESS = "fakesrc ! queue max-size-buffers=50 ! identity sleep-time=200000 ! fakesink"


HANGS = """
import time
from streamkit import Sink
class Hangs(Sink):
    sink = "ANY"
    def render(self, frame):
        pass
    def stop(self):
        time.sleep(100)
"""


WAITS = """
import sys
from streamkit import Sink
class Waits(Sink):
    sink = "ANY"
    def start(self):
        sys.stdin.readline()
    def render(self, frame):
        pass
"""


def install(folder: Path, name: str, code: str) -> dict[str, str]:
    """Makes the element of a module known; the variables with which a process finds it."""
    (folder / f"{name}.py").write_text(code, encoding="utf-8")
    (folder / f"{name}-1.dist-info").mkdir()
    (folder / f"{name}-1.dist-info" / "entry_points.txt").write_text(
        f"[streamkit.elements]\n{name} = {name}:{name.capitalize()}\n", encoding="utf-8"
    )
    return {"PYTHONPATH": os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])}


def on_terminal(
    *arguments: str, keys: Sequence[tuple[str, bytes]] = (), variables: Mapping[str, str] = NO_VARIABLES
) -> tuple[int, str]:
    """Exit code and output of `launch` on a terminal.

    Args:
        *arguments: of launch.
        keys: what is typed, each after a text has appeared.
        variables: of its environment.
    """
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 80, 0, 0))
    with subprocess.Popen(
        [*TAKE_TERMINAL, BINARY, "launch", *arguments], stdout=slave, stderr=slave, start_new_session=True,
        env={**os.environ, "TERMINAL": os.ttyname(slave), "COLUMNS": "80", **variables},
    ) as process:  # fmt: skip
        os.close(slave)
        try:
            out = _read_all(master, list(keys))
            return process.wait(LIMIT_S), out
        finally:
            process.kill()
            os.close(master)


def _read_all(master: int, keys: list[tuple[str, bytes]]) -> str:
    out, seen, deadline = b"", 0, time.monotonic() + LIMIT_S
    while time.monotonic() < deadline:
        if select.select([master], [], [], 0.2)[0]:
            try:
                out += os.read(master, 65536)
            except OSError:  # the other side has been closed
                return out.decode()
        if keys and (place := out.find(keys[0][0].encode(), seen)) >= 0:
            seen = place + len(keys[0][0])
            os.write(master, keys.pop(0)[1])
    raise AssertionError(f"no end within {LIMIT_S} s: {out!r}")


def lines_of(out: str) -> list[str]:
    """The lines on the screen, without colours; a redrawn line has its last state."""
    plain = CONTROL.sub("", out.replace("\r\n", "\n"))
    return [line.rpartition("\r")[2].rstrip() for line in plain.split("\n")]


def test_the_progress_line_is_redrawn_in_place() -> None:
    """Time, position, frames and rate; the last line is of the whole run."""
    code, out = on_terminal(SLOW)
    assert code == 0
    assert re.search(r"  at [01]\.\d of 2\.2 s \(\d+ %", out)
    assert out.count("\x1b[K") > 3
    (line,) = [line for line in lines_of(out) if line]
    assert re.fullmatch(r"66 frames in \d\.\d s, \d+\.\d/s", line)


def test_a_start_that_takes_long_is_counted(tmp_path: Path) -> None:
    """As one that compiles loops; the line is gone when the pipeline plays."""
    variables = install(tmp_path, "waits", WAITS)
    code, out = on_terminal("fakesrc num-buffers=3 ! waits", keys=[("starting", b"\n")], variables=variables)
    assert code == 0
    assert re.search(r"\r    [1-9]\.\d s  starting", out)
    assert out.rindex("starting") < out.rindex("\r\x1b[K") < out.rindex("3 frames in")


def test_a_file_shows_how_much_is_left(streamkit_data: Path) -> None:
    """Also where no sink is synchronised: the position is then that of the source."""
    source = streamkit_data / "video" / "fixed_camera_cars.mp4"
    code, out = on_terminal(f"filesrc location={source} ! identity sleep-time=2000 ! fakesink")
    assert code == 0
    plain = CONTROL.sub("", out)
    line = r"\r([━╸╺]+)  at \d+\.\d of 30\.2 s \(\d+ %, 0:\d\d left\)  \d+ frames  \d+\.\d/s"
    drawn = re.findall(line, plain)
    assert {len(each) for each in drawn} == {20}
    assert max(map(len, re.split(r"[\r\n]+", plain))) < 80


def test_quiet_draws_nothing() -> None:
    """Also on a terminal."""
    assert on_terminal("-q", SLOW.replace("66", "3")) == (0, "")


def test_the_table_is_redrawn_in_place() -> None:
    """One row per element, with queue levels; messages are above; the last state stays."""
    code, out = on_terminal("--stats", "-v", SLOW)
    assert code == 0
    assert "state: pipeline: playing" in lines_of(out)
    assert out.count("element") > 3
    rows = [line.split() for line in lines_of(out)[-13:]]
    assert [row[0] for row in rows if row[:1] == ["main"]] == ["main"]
    sink = next(row for row in rows if row[:1] == ["fakesink0"])
    assert sink[1:3] == ["66", "0"]
    queue = next(row for row in rows if row[:1] == ["queue0"])
    assert queue[1:3] == ["66", "66"]
    assert "0/200" in queue


def test_control_c_is_a_clean_stop() -> None:
    """With code 0, in time."""
    code, out = on_terminal("-v", ENDLESS, keys=[("pipeline: playing", b"\x03")])
    assert code == 0
    assert "state: pipeline: null" in out
    assert "eos: pipeline" not in out


def test_control_c_with_e_ends_the_stream_first() -> None:
    """Frames in flight still arrive."""
    text = ENDLESS.replace("50", "2")
    code, out = on_terminal("-v", "-e", text, keys=[("pipeline: playing", b"\x03")])
    assert code == 0
    assert "interrupt: ending the stream; Ctrl-C again stops at once" in out
    assert "eos: pipeline: end of stream" in out


def test_a_second_control_c_does_not_wait_for_the_end() -> None:
    """Ten seconds of frames are still queued."""
    began = time.monotonic()
    keys = [("pipeline: playing", b"\x03"), ("interrupt: ending", b"\x03")]
    code, out = on_terminal("-v", "-e", ENDLESS, keys=keys)
    assert code == 0
    assert "eos: pipeline" not in out
    assert "state: pipeline: null" in out
    assert time.monotonic() - began < 9


def test_a_second_control_c_ends_a_process_that_hangs(tmp_path: Path) -> None:
    """An element does not stop; the cursor is shown again."""
    keys = [("hangs0", b"\x03"), ("interrupt: stopping", b"\x03")]
    variables = install(tmp_path, "hangs", HANGS)
    code, out = on_terminal("--stats", "fakesrc is-live=true ! hangs", keys=keys, variables=variables)
    assert code == 128 + 2
    assert out.rindex("\x1b[?25h") > out.rindex("\x1b[?25l")


def test_a_live_source_reports_the_age_of_frames() -> None:
    """The age of the newest frame at the sink."""
    code, out = on_terminal("fakesrc is-live=true num-buffers=20 ! queue ! fakesink")
    assert code == 0
    assert re.search(r"\d+ frames  \d+\.\d/s, \d+ ms old", out)


def test_errors_replace_the_progress_line() -> None:
    """The progress line is cleared first."""
    code, out = on_terminal("fakesrc ! identity sleep-time=100000 ! identity error-after=8 ! fakesink")
    assert code == 1
    assert any(line.startswith("error: identity1: ") for line in lines_of(out))


def test_a_terminal_that_is_closed_ends_the_pipeline_cleanly(tmp_path: Path) -> None:
    """As SIGTERM: files are complete, though nothing can be printed."""
    path = tmp_path / "tracks.geojson"
    master, slave = pty.openpty()
    text = f"videotestsrc is-live=true ! video/x-raw,width=16,height=16 ! tracksink location={path}"
    with subprocess.Popen(
        [*TAKE_TERMINAL, BINARY, "launch", "-v", text], stdout=slave, stderr=slave, start_new_session=True,
        env={**os.environ, "TERMINAL": os.ttyname(slave)},
    ) as process:  # fmt: skip
        os.close(slave)
        out = b""
        while not path.exists():
            out += os.read(master, 65536)
        os.close(master)
        assert process.wait(LIMIT_S) == 0
    assert json.loads(path.read_bytes())["features"] == []
