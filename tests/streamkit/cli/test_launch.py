"""`streamkit launch`: exit codes, errors, interrupts."""

import json
import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from streamkit import Caps, Frame, Property, Sink, Source, Transform
from streamkit.cli.description import join_arguments

Register = Callable[..., None]
COMMAND = [str(Path(sys.executable).with_name("streamkit")), "launch"]


def before_last_line(done: Result) -> str:
    """What is on stderr before the last line, which says what the run has made."""
    *lines, last = done.stderr.splitlines(keepends=True)
    assert re.match(r"\d+ frames? in \d+\.\d s", last), done.stderr
    return "".join(lines)


def test_eos_is_exit_code_0(launch: Callable[..., Result]) -> None:
    """Only the last line is printed, on stderr; with -q nothing is, unless the line is asked for."""
    done = launch("fakesrc num-buffers=3 ! fakesink")
    assert (done.exit_code, done.stdout, before_last_line(done)) == (0, "", "")
    assert done.stderr.startswith("3 frames in ")
    assert launch("-q", "fakesrc num-buffers=3 ! fakesink").stderr == ""
    assert launch("-q", "--summary", "fakesrc num-buffers=3 ! fakesink").stderr.startswith("3 frames in ")


def test_a_failure_is_one_line_and_code_1(launch: Callable[..., Result]) -> None:
    """Element, cause and frame; no traceback."""
    done = launch("fakesrc ! identity error-after=2 ! fakesink")
    assert done.exit_code == 1
    assert before_last_line(done) == (
        "error: identity0: error-after=2: the frame at which to fail has come [at frame seq=1]\n"
    )


def test_a_bad_description_points_into_the_text_with_code_2(launch: Callable[..., Result]) -> None:
    """The line is printed with carets below the error."""
    done = launch("fakesrc ! fakesnk")
    assert done.exit_code == 2
    assert done.stderr == (
        'description:1:11: no element "fakesnk"; did you mean "fakesink"?\n'
        "    fakesrc ! fakesnk\n"
        "              ^^^^^^^\n"
    )


def test_a_file_is_named_in_its_errors(launch: Callable[..., Result], tmp_path: Path) -> None:
    """A .pipe file has comments, line breaks and variables; errors name file, line and column."""
    file = tmp_path / "track.pipe"
    file.write_text(
        "# count and forget\nfakesrc num-buffers=${N:-2}\n    ! identiti ! ${SINK}\n", encoding="utf-8"
    )
    done = launch("-f", str(file), "--set", "SINK=fakesink")
    assert done.exit_code == 2
    assert done.stderr == (
        f'{file}:3:7: no element "identiti"; did you mean "identity"?\n'
        "        ! identiti ! ${SINK}\n"
        "          ^^^^^^^^\n"
    )
    file.write_text(file.read_text(encoding="utf-8").replace("identiti", "identity"), encoding="utf-8")
    assert launch("-f", str(file), "--set", "SINK=fakesink").exit_code == 0


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("fakesrc !  x", {"code": "no-such-element", "message": 'no element "x"', "line": 1, "column": 12,
                           "length": 1, "hint": ""}),
        ("fakesrc\n! fakesnk", {"code": "no-such-element", "message": 'no element "fakesnk"', "line": 2,
                                 "column": 3, "length": 7, "hint": 'did you mean "fakesink"?'}),
        ("", {"code": "empty", "message": "the description is empty: write at least one element", "line": 1,
              "column": 1, "length": 1, "hint": ""}),
    ],
)  # fmt: skip
def test_errors_as_json(launch: Callable[..., Result], text: str, error: dict[str, Any]) -> None:
    """One object with the fields of the design, and nothing else, on stderr."""
    done = launch("--json-errors", text)
    assert done.exit_code == 2
    assert json.loads(done.stderr) == {"error": error}
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "error: give a DESCRIPTION, or a file with -f FILE\n"),
        (["-f", "x.pipe", "fakesrc"], "error: give a DESCRIPTION or a file with -f, not both\n"),
        (
            ["-f", "no/such.pipe"],
            "error: cannot read the description no/such.pipe: No such file or directory\n",
        ),
        (["--set", "X", "fakesrc"], "error: --set takes NAME=VALUE, got 'X'\n"),
        (
            ["--gst-debug=3", "fakesrc ! fakesink"],
            "error: No such option: --gst-debug; here: -v, which prints more, and --stats, which counts\n",
        ),
        (
            ["fakesrc ! fakesink", "-m"],
            "error: No such option: -m; here: -v, which prints every message\n",
        ),
        (["--version"], "error: No such option: --version; here: `streamkit --version`\n"),
    ],
)
def test_wrong_usage_is_code_2(launch: Callable[..., Result], arguments: list[str], message: str) -> None:
    """The message says what to write."""
    done = launch(*arguments)
    assert (done.exit_code, done.stderr) == (2, message)


@pytest.mark.parametrize("content", [b"\xff\xfe fakesrc", b"x" * 1_000_001])
def test_an_unreadable_description_file_is_refused(
    launch: Callable[..., Result], tmp_path: Path, content: bytes
) -> None:
    """Not UTF-8, or too large."""
    file = tmp_path / "odd.pipe"
    file.write_bytes(content)
    done = launch("-f", str(file))
    assert done.exit_code == 2
    assert done.stderr.startswith("error: ")


def test_several_arguments_are_joined_as_gst_launch_does() -> None:
    """g10 to g14: blanks inside an argument are escaped outside double quotes."""
    assert join_arguments(["fakesrc ! fakesink"]) == "fakesrc ! fakesink"
    assert join_arguments(["fakesrc", "!", "fakesink"]) == "fakesrc ! fakesink"
    assert join_arguments(["filesrc", "location=a b"]) == r"filesrc location=a\ b"
    assert join_arguments(["filesrc", 'location="a b"']) == 'filesrc location="a b"'
    assert join_arguments(["a", "! video/x-raw, width=3 !", "b"]) == r"a !\ video/x-raw,\ width=3\ ! b"


def test_several_arguments_run(launch: Callable[..., Result]) -> None:
    """A filter with blanks works as one argument."""
    done = launch("-q", "fakesrc", "num-buffers=1", "!", "video/x-raw, width=3", "!", "fakesink")
    assert (done.exit_code, done.stderr) == (0, "")


def test_verbose_prints_states_caps_and_messages(launch: Callable[..., Result]) -> None:
    """In order, with their element or the pipeline; caps of each link once."""
    done = launch("-v", "fakesrc num-buffers=1 ! a/b,x=1 ! fakesink silent=false")
    lines = done.stderr.splitlines()
    states = [line.split()[-1] for line in lines if line.startswith("state: pipeline: ")]
    assert (states[0], states[-2:]) == ("ready", ["playing", "null"])
    assert "eos: pipeline: end of stream" in lines
    assert any(line.startswith("element: fakesink0: ") for line in lines)
    assert [line for line in lines if line.startswith("caps: ")] == [
        "caps: fakesrc0.src -> capsfilter0.sink: a/b, x=(int)1",
        "caps: capsfilter0.src -> fakesink0.sink: a/b, x=(int)1",
    ]


DROPS_ALL = "fakesrc num-buffers=4 ! identity drop-probability=1 ! fakesink"


def test_statistics_as_json_are_one_object(launch: Callable[..., Result], tmp_path: Path) -> None:
    """On stdout or in a file: frames in, frames out, drops with reasons of every element."""
    file = tmp_path / "statistics.json"
    done = launch("--stats=json", "--stats-file", str(file), DROPS_ALL)
    assert (done.exit_code, before_last_line(done)) == (0, "")
    found = json.loads(done.stdout)
    assert json.loads(file.read_text(encoding="utf-8")) == found
    assert found["schema"] == "streamkit.statistics/1"
    rows = (
        (row["element"], row["frames_in"], row["frames_out"], row["dropped"]) for row in found["elements"]
    )
    assert [(name, came, left, sum(dropped.values())) for name, came, left, dropped in rows] == [
        ("fakesrc0", 0, 4, 0), ("identity0", 4, 0, 4), ("fakesink0", 0, 0, 0),
    ]  # fmt: skip


def test_statistics_of_a_failed_run_are_printed_too(launch: Callable[..., Result]) -> None:
    """Counters up to the failure are printed; the exit code stays 1."""
    done = launch("--stats=json", "fakesrc ! identity error-after=3 ! fakesink")
    assert done.exit_code == 1
    row = json.loads(done.stdout)["elements"][1]
    assert (row["frames_in"], row["errors"]) == (3, 1)


def test_statistics_do_not_overwrite_a_file_of_the_pipeline(
    launch: Callable[..., Result], tmp_path: Path
) -> None:
    """A wrong name must not cost a flight."""
    flight = tmp_path / "flight.mp4"
    flight.write_bytes(b"video")
    done = launch("--stats-file", str(flight), f"filesrc location={flight} ! fakesink")
    assert done.exit_code == 2
    unwrapped = " ".join(done.stderr.replace("│", " ").split())
    assert "a file of filesrc0; name another" in unwrapped
    assert flight.read_bytes() == b"video"


def test_a_statistics_file_that_cannot_be_written_is_code_1(launch: Callable[..., Result]) -> None:
    """The reason is printed, before a run of hours whose counters would be lost."""
    done = launch("--stats-file", "/etc/passwd/x.json", DROPS_ALL)
    assert done.exit_code == 1
    assert done.stderr.startswith("error: --stats-file /etc/passwd/x.json cannot be written: ")
    assert "frames in" not in done.stderr


def test_text_statistics_end_with_a_table(launch: Callable[..., Result]) -> None:
    """On stderr; stdout stays empty."""
    for arguments in (["--stats", DROPS_ALL], ["-q", "--stats", DROPS_ALL], [DROPS_ALL, "--stats"]):
        done = launch(*arguments)
        assert (done.exit_code, done.stdout) == (0, "")
        rows = [line.split() for line in done.stderr.splitlines()]
        assert ["element", "in", "out", "/s", "dropped", "errors", "busy", "queue", "(most)", "age"] in rows
        identity = next(row for row in rows if row[:1] == ["identity0"])
        assert identity[1:3] == ["4", "0"]
        assert "4" in identity[4]


def test_text_statistics_without_a_terminal_are_lines(launch: Callable[..., Result]) -> None:
    """One line every second."""
    done = launch(
        "--stats", "videotestsrc num-buffers=36 ! video/x-raw,framerate=30/1 ! queue ! fakesink sync=true"
    )
    lines = [line for line in done.stderr.splitlines() if line.startswith("stats ")]
    assert len(lines) == 1
    assert re.match(
        r"stats 1\.\d s \| videotestsrc0 out \d+ \d+\.\d/s busy \d+%.* \| queue0 in \d+ out \d+", lines[0]
    )


def test_the_counters_of_each_process_are_shown(launch: Callable[..., Result]) -> None:
    """In the last table and in the JSON; without process bins there is only the main one."""
    in_process = DROPS_ALL.replace("!", "! ( name=apart process=true identity ) !", 1)
    for text, names in ((DROPS_ALL, ["main"]), (in_process, ["main", "apart"])):
        done = launch("--stats=json", text)
        rows = json.loads(done.stdout)["processes"]
        assert [row["process"] for row in rows] == names
    done = launch("--stats", in_process)
    row = r"^ apart +\d+\.\d\d s +(\d+% +)?\d+ MiB +\d+ +\d+ +\d+\.\d\d s"  # a share only after some time
    assert re.search(row, done.stderr, re.MULTILINE)


def test_an_unknown_format_of_statistics_is_code_2(launch: Callable[..., Result]) -> None:
    """The message lists the formats."""
    done = launch("--stats=xml", DROPS_ALL)
    assert done.exit_code == 2
    assert "'xml' is not one of 'text', 'json'" in done.stderr


class Talkative(Sink):
    """Warns, and has a secret."""

    sink = "ANY"
    password: str = Property("", secret=True)
    pin: int = Property(0, max=9, secret=True)

    def render(self, frame: Frame) -> None:
        self.post_warning("lens is dirty")


def test_warnings_are_shown_unless_quiet(launch: Callable[..., Result], register: Register) -> None:
    """A warning does not change the exit code."""
    register(talkative=Talkative)
    done = launch("fakesrc num-buffers=1 ! talkative name=t")
    assert (done.exit_code, before_last_line(done)) == (0, "warning: t: lens is dirty\n")
    assert launch("-q", "fakesrc num-buffers=1 ! talkative").stderr == ""


def test_a_secret_in_a_variable_is_never_shown(launch: Callable[..., Result], register: Register) -> None:
    """Not in the quoted line, the message or verbose output."""
    register(talkative=Talkative)
    for text in ("talkative pin=${SECRET}", "fakesrc num-buffers=1 ! talkative password=${SECRET} ! x",
                 "fakesrc num-buffers=1 ! talkative password=${SECRET}"):  # fmt: skip
        done = launch("-v", "--json-errors", "--set", "SECRET=4711", text)
        assert "4711" not in done.stderr + done.stdout
        done = launch("-v", "--set", "SECRET=4711", text)
        assert "4711" not in done.stderr + done.stdout


def test_a_failed_start_is_code_1(launch: Callable[..., Result], register: Register) -> None:
    """A missing resource and failing stops are reported once."""

    class Fails(Talkative):
        """Cannot start."""

        def start(self) -> None:
            raise OSError("no device")

    register(fails=Fails)
    done = launch("fakesrc ! fails")
    place = f"{Path(__file__).name}:{Fails.start.__code__.co_firstlineno + 1}"
    assert (done.exit_code, done.stderr) == (1, f"error: fails0: OSError: no device ({place})\n")


def test_a_connection_that_is_back_is_told(
    launch: Callable[..., Result], register: Callable[..., None]
) -> None:
    """Without -v: the warning of the loss was printed, too. With -v every state is."""

    class Flaky(Source):
        src = "a/b"

        def frames(self) -> Iterator[Frame]:
            for state in ("connected", "retrying", "connecting", "connected"):
                self.post_message("connection", state=state)
            yield Frame(b"", Caps("a/b"))

    register(flaky=Flaky)
    assert before_last_line(launch("flaky ! fakesink")) == "note: flaky0: connected again\n"
    assert "element: flaky0: connection state=retrying\n" in launch("-v", "flaky ! fakesink").stderr
    assert launch("-q", "flaky ! fakesink").stderr == ""


@pytest.mark.parametrize("method", ["start", "render"])
def test_verbose_prints_the_traceback_of_a_failed_element(
    launch: Callable[..., Result], register: Register, method: str
) -> None:
    """With -v the traceback precedes the error; without it the error is one line with file and line."""

    def fail(self: Sink, *_: Frame) -> None:
        raise LookupError("never foreseen")

    register(fails=type("Fails", (Sink,), {"sink": "ANY", method: fail, "__doc__": "Fails."}))
    reported = launch("-v", "fakesrc num-buffers=1 ! fails").stderr
    assert 'raise LookupError("never foreseen")' in reported
    assert f'{Path(__file__).name}", line {fail.__code__.co_firstlineno + 1}, in fail' in reported
    plain = launch("-q", "fakesrc num-buffers=1 ! fails").stderr
    assert plain.startswith("error: fails0: LookupError: never foreseen")
    assert plain.endswith(f" ({Path(__file__).name}:{fail.__code__.co_firstlineno + 1})\n")
    assert plain.count("\n") == 1


def test_the_time_of_the_start_is_not_that_of_the_run(
    launch: Callable[..., Result], register: Register
) -> None:
    """Else rates and the time left would be wrong after loops were compiled."""
    start_s = 2.0

    class Slow(Talkative):
        """Takes its time."""

        def start(self) -> None:
            time.sleep(start_s)

    register(slow=Slow)
    done = launch("--stats=json", "fakesrc num-buffers=3 ! slow")
    assert json.loads(done.stdout)["elapsed_s"] < start_s


@pytest.mark.parametrize("returned", [5, [5]])
def test_an_error_of_a_result_names_the_class_that_returned_it(
    launch: Callable[..., Result], register: Register, returned: object
) -> None:
    """And not the line of the engine that checks it."""

    class Wrong(Transform):
        """Returns what is no frame."""

        sink = src = "ANY"

        def transform(self, frame: Frame) -> Any:
            return returned

    register(wrong=Wrong)
    done = launch("fakesrc num-buffers=1 ! wrong ! fakesink")
    assert "wrong0: TypeError: transform returns a Frame, several, or None, got " in done.stderr
    assert before_last_line(done).endswith(f" ({Path(__file__).name}, class Wrong)\n")


def test_an_error_within_a_library_names_the_line_that_calls_it(
    launch: Callable[..., Result], register: Register
) -> None:
    """And not a line of the library, which the author of the element does not know."""

    def render(self: Sink, _: Frame) -> None:
        textwrap.indent(None, "")  # type: ignore[arg-type]

    register(fails=type("Fails", (Sink,), {"sink": "ANY", "render": render, "__doc__": "Fails."}))
    place = f"{Path(__file__).name}:{render.__code__.co_firstlineno + 1}"
    assert before_last_line(launch("fakesrc num-buffers=1 ! fails")).endswith(f" ({place})\n")


@pytest.mark.parametrize(
    ("arguments", "number", "has_eos"),
    [
        (["-v"], signal.SIGINT, False),
        (["-v", "-e"], signal.SIGINT, True),
        (["-v"], signal.SIGTERM, False),
        (["-v"], signal.SIGHUP, False),
    ],
)
def test_an_interrupt_is_a_clean_stop(arguments: list[str], number: int, has_eos: bool) -> None:
    """Ctrl-C stops in time with code 0; with -e the stream ends first, after its last frame."""
    text = "fakesrc ! queue max-size-buffers=5 ! identity sleep-time=100 ! fakesink"
    with subprocess.Popen([*COMMAND, *arguments, text], stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            for line in process.stderr:
                if line.startswith("state: pipeline: playing"):
                    break
            process.send_signal(number)
            rest = process.stderr.read()
            assert process.wait(20) == 0
        finally:
            process.kill()
    assert "state: pipeline: null" in rest
    assert ("eos: pipeline" in rest) is has_eos
    assert "error" not in rest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupt_during_the_build_is_a_clean_stop(
    launch: Callable[..., Result], register: Register, number: int
) -> None:
    """Ctrl-C ends the command at once with exit code 0."""

    class Interrupted(Sink):
        """Takes long to make."""

        sink = "ANY"

        def __init__(self, name: str = "", **properties: Any) -> None:
            signal.raise_signal(number)
            super().__init__(name, **properties)

    register(interrupted=Interrupted)
    done = launch("fakesrc ! interrupted")
    assert (done.exit_code, done.stdout, done.stderr) == (0, "", "interrupt: stopped before it played\n")
    assert launch("-q", "fakesrc ! interrupted").stderr == ""


def test_a_setting_for_no_variable_is_reported(launch: Callable[..., Result]) -> None:
    """A mistyped name would leave the default in its place unseen; the names there are stand beside it."""
    text = "fakesrc num-buffers=${count:-2} ! fakesink name=${name:-end}"
    done = launch("--set", "cuont=7", "--set", "name=b", text)
    assert done.exit_code == 0
    assert before_last_line(done) == (
        "note: --set cuont is not used: the description has no ${cuont}; it has count, name\n"
    )
    done = launch("--set", "count=1", "fakesrc num-buffers=1 ! fakesink")
    assert before_last_line(done) == (
        "note: --set count is not used: the description has no ${count}; it has no variables\n"
    )
    done = launch("--set", "name=b", "fakesrc num-buffers=1 ! fakesink name=$name")
    assert before_last_line(done) == (
        "note: --set name is not used: the description has no ${name}; write it for $name\n"
    )
    assert launch("-q", "--set", "cuont=7", text).stderr == ""


def test_exit_codes_of_the_installed_command() -> None:
    """0, 1 and 2; with -q only the error is printed."""
    for text, code in (
        ("fakesrc num-buffers=1 ! queue ! fakesink", 0),
        ("fakesrc ! queue ! identity error-after=1 ! fakesink", 1),
        ("fakesrc !", 2),
    ):
        command = [*COMMAND, "-q", text]
        done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
        assert done.returncode == code
        assert done.stdout == ""
        assert bool(done.stderr) is bool(code)
        assert "Traceback" not in done.stderr


PROGRAMS = {
    "command": (
        "from streamkit.cli.main import main\n"
        "sys.argv[1:] = ['launch', 'fakesrc num-buffers=1 ! fakesink']\n"
        "try:\n    main()\nexcept SystemExit as left:\n    assert not left.code\n"
    ),
    "library": "import streamkit\n",
}


def output_with_threads(code: str, wanted: str | None) -> str:
    """What Python prints where the user has set the number of threads of linear algebra, or has not."""
    inherited = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    own = {} if wanted is None else {"OPENBLAS_NUM_THREADS": wanted}
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=inherited | own,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    return done.stdout


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize(("wanted", "threads"), [(None, "1"), ("3", "3")])
def test_blas_is_limited_to_one_thread(program: str, wanted: str | None, threads: str) -> None:
    """A value set by the user is kept."""
    code = (
        f"import os, sys\n{PROGRAMS[program]}"
        "assert 'numpy' not in sys.modules\n"
        "import numpy as np\n"
        "square = np.ones((600, 600)) @ np.ones((600, 600))\n"
        "print(os.environ['OPENBLAS_NUM_THREADS'], len(os.listdir('/proc/self/task')))\n"
    )
    reported, running = output_with_threads(code, wanted).split()
    assert reported == threads
    assert int(running) <= int(threads)


@pytest.mark.parametrize(("wanted", "limit"), [(None, 1), ("2", 2)])
def test_blas_is_limited_in_a_program_that_has_imported_numpy(wanted: str | None, limit: int) -> None:
    """It has read its variable then; twice the processor time of tracking would go into its threads."""
    code = (
        "import numpy, threadpoolctl, streamkit\n"
        "print([found['num_threads'] for found in threadpoolctl.threadpool_info()])\n"
    )
    assert output_with_threads(code, wanted) == f"[{min(limit, len(os.sched_getaffinity(0)))}]\n"


@pytest.mark.parametrize("closed", ["2>&-", ">&- 2>&-", "<&- >&- 2>&-", "2>/dev/full"])
def test_closed_standard_streams_do_no_harm(tmp_path: Path, closed: str) -> None:
    """Messages do not get into a file of the pipeline, and do not end it."""
    path = tmp_path / "a.raw"
    text = f"videotestsrc num-buffers=3 ! video/x-raw,width=16,height=16 ! filesink location={path}"
    shell = f'exec "$0" launch -v --set unused=1 "$1" {closed}'
    done = subprocess.run(["sh", "-c", shell, COMMAND[0], text], timeout=30, check=False)
    assert done.returncode == 0
    assert path.stat().st_size == 3 * 16 * 16 * 3 // 2
    assert b"state" not in path.read_bytes()


@pytest.mark.parametrize("method", ["__init__", "start", "render", "drain", "stop"])
def test_system_exit_of_an_element_is_an_error(
    launch: Callable[..., Result], register: Register, method: str
) -> None:
    """It is reported with the element's name, and neither ends the process nor hangs."""

    def leave(self: Sink, *_: Any, **__: Any) -> None:
        raise SystemExit(0)

    register(
        leaves=type("Leaves", (Sink,), {"sink": "ANY", "render": print, method: leave, "__doc__": "Leaves."})
    )
    done = launch("-q" if method != "stop" else "-v", "fakesrc num-buffers=1 ! leaves")
    assert "leaves" in done.stderr
    assert "SystemExit" in done.stderr
    assert done.exit_code == {"__init__": 2, "stop": 0}.get(method, 1)


@pytest.mark.parametrize("sink", ["tracksink location={}/t.jsonl", "zenohsink key=launch/empty"])
def test_an_empty_scene_is_noted(launch: Callable[..., Result], tmp_path: Path, sink: str) -> None:
    """No target is legitimate, so even with --strict the run succeeds."""
    pipeline = f"videotestsrc num-buffers=5 ! framediff ! particletrack ! {sink.format(tmp_path)} name=t"
    done = launch("--strict", pipeline)
    assert done.exit_code == 0
    (line,) = [line for line in done.stderr.splitlines() if "no target in any of 5 frames" in line]
    assert line.startswith("note: t: ")


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        (
            "videotestsrc pattern=black num-buffers=2 ! stitch location={}/m.png ! fakesink",
            "no mosaic: none of 2",
        ),
        ("videotestsrc num-buffers=2 ! tracksink location={}/t.jsonl", "put particletrack before it"),
        ("videotestsrc num-buffers=2 ! detectionsink location={}/d.jsonl", "put framediff before it"),
        ("videotestsrc num-buffers=2 ! featuresink location={}/f.npz", "put waveleteigen before it"),
        ("videotestsrc num-buffers=2 ! cotsink", "put particletrack before it"),
        ("fakesrc num-buffers=0 ! filesink location={}/x", "no frame came, nothing is written"),
        *(
            (f"videotestsrc num-buffers=3 ! valve drop=1 ! {sink}", "no frame came, nothing is written")
            for sink in (
                "filesink location={}/x",
                "videofilesink location={}/e.mp4",
                "jpegsink location={}/e%d.jpg",
                "encode ! packetsink location={}/e.ts",
                "tracksink location={}/t.jsonl",
            )
        ),
    ],
)
def test_a_run_without_results_is_reported(
    launch: Callable[..., Result], tmp_path: Path, text: str, reported: str
) -> None:
    """As a warning and in the statistics; with --strict the exit code is 1."""
    done = launch("--stats=json", text.format(tmp_path))
    assert done.exit_code == 0
    assert reported in done.stderr
    assert any(reported in shortfall for shortfall in json.loads(done.stdout)["shortfalls"])
    strict = launch("--strict", "-q", text.format(tmp_path))
    assert strict.exit_code == 1
    assert strict.stderr.startswith("error: ")
    assert reported in strict.stderr
    assert launch("--strict", "fakesrc num-buffers=1 ! fakesink").exit_code == 0


def test_elements_that_wait_for_an_application_are_noted(launch: Callable[..., Result]) -> None:
    """`launch` has none: behind an appsink a long stream would stand still without a word."""
    done = launch("fakesrc num-buffers=1 ! appsink name=out")
    assert (done.exit_code, done.stdout) == (0, "")
    assert before_last_line(done) == (
        "note: out fills up, as only a Python program takes its frames; write fakesink here\n"
    )
    done = launch("fakesrc num-buffers=1 ! appsink drop=true")
    assert done.stderr.startswith("note: appsink0 drops frames, as only a Python program takes its frames; ")
    assert launch("-q", "fakesrc num-buffers=1 ! appsink").stderr == ""


def test_an_open_end_is_noted(launch: Callable[..., Result]) -> None:
    """Behind a tee the run goes on, as in GStreamer, and a forgotten sink would not show before its end."""
    done = launch("fakesrc num-buffers=1 ! tee name=t ! fakesink  t. ! queue ! identity")
    assert done.exit_code == 0
    assert before_last_line(done) == (
        "note: identity0.src is not linked, its frames go nowhere; link it to a sink\n"
    )


@pytest.mark.parametrize(
    ("element", "source"), [("detectionsrc", "filesrc location=FILE ! decode"), ("queue", "a source")]
)
def test_an_open_beginning_is_noted_with_what_to_write(
    launch: Callable[..., Result], element: str, source: str
) -> None:
    """`detectionsrc` sounds like a source, and takes frames."""
    done = launch(f"{element} ! fakesink")
    assert done.exit_code == 1
    note = f"note: {element}0.sink is not linked, no frame comes; write {source} ! before {element}\n"
    assert done.stderr.startswith(note)
    assert f"error: {element}0: nothing is linked to its pad sink" in done.stderr


def test_log_lines_begin_with_the_time_on_request(launch: Callable[..., Result]) -> None:
    """So that a log file tells when a feed was lost; UTC, as in JSON lines."""
    done = launch("--log-format", "timed", "fakesrc num-buffers=3 ! identity error-after=1 ! fakesink")
    lines = done.stderr.splitlines()
    assert [line.split(" ")[1] for line in lines] == ["error:", "0"]
    ages = [datetime.now(UTC) - datetime.fromisoformat(line.split(" ")[0]) for line in lines]
    assert timedelta(0) <= min(ages) <= max(ages) < timedelta(minutes=1)


def test_log_lines_are_json_objects_on_request(launch: Callable[..., Result]) -> None:
    """Each line of stderr has time, level and message, and the element if it is about one."""
    done = launch(
        "--log-format", "json", "fakesrc num-buffers=3 ! identity error-after=1 name=bad ! fakesink"
    )
    assert done.exit_code == 1
    lines = [json.loads(line) for line in done.stderr.splitlines()]
    assert [line["level"] for line in lines] == ["error", "note"]
    assert lines[1]["message"].startswith("0 frames in ")
    assert lines[0]["element"] == "bad"
    assert datetime.fromisoformat(lines[0]["time"]).tzinfo is not None
    bad = launch("--log-format", "json", "nothing ! fakesink")
    assert json.loads(bad.stderr)["error"]["code"] == "no-such-element"


@pytest.mark.parametrize(
    ("arguments", "code", "level", "message"),
    [
        (("nothing ! fakesink",), 2, "error", 'no element "nothing"'),
        (("--set", "wrong", "fakesrc ! fakesink"), 2, "error", "--set takes NAME=VALUE, got 'wrong'"),
        (("--stats-fil", "a", "fakesrc ! fakesink"), 2, "error", "No such option: --stats-fil"),
        (("--watchdog-s", "-1", "fakesrc ! fakesink"), 2, "error", "Invalid value for '--watchdog-s': -1.0"),
        (
            ("--stats-file", "here.raw", "fakesrc ! filesink location=here.raw"),
            2, "error", "Invalid value for --stats-file: here.raw is a file of filesink0; name another",
        ),
        (("--metrics", "nowhere", "fakesrc ! fakesink"), 2, "error", "HOST:PORT, got 'nowhere'"),
        (("--summary", "fakesrc num-buffers=3 ! fakesink"), 0, "note", "3 frames in"),
    ],
)  # fmt: skip
def test_every_line_of_stderr_is_json(
    launch: Callable[..., Result], arguments: tuple[str, ...], code: int, level: str, message: str
) -> None:
    """Usage errors, bad descriptions and the summary have the shape of all other lines."""
    done = launch("--log-format", "json", *arguments)
    assert done.exit_code == code
    (line,) = [json.loads(line) for line in done.stderr.splitlines()]
    assert line["level"] == level
    assert message in line["message"]
    assert datetime.fromisoformat(line["time"]).tzinfo is not None


def test_metrics_at_an_address_that_cannot_be_used_are_a_usage_error(launch: Callable[..., Result]) -> None:
    """Nothing plays."""
    done = launch("--metrics", "nowhere", "fakesrc ! fakesink")
    assert done.exit_code == 2
    assert "HOST:PORT, got 'nowhere'" in done.stderr
