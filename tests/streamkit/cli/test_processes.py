"""`launch --processes auto`: measures, then runs the description with bins in processes."""

import json
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from streamkit import Pipeline, Property, Transform
from streamkit.cli import processes
from streamkit.graph.build import build

WORK = "identity sleep-time=20000"
VIDEO = "videotestsrc num-buffers=20 ! video/x-raw, width=64, height=48, format=GRAY8"


@pytest.fixture(autouse=True)
def _two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "available_cores", lambda: 2)
    monkeypatch.setattr(processes, "MEASURE_S", 60.0)  # to the end of these streams


def test_work_is_spread_over_two_processes(
    launch: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The description is printed with its bin; measuring has not written the file."""
    shared: list[int] = []
    monkeypatch.setattr("streamkit.cli.launch.share_cores", shared.append)
    tail = f"filesink if-exists=fail location={tmp_path / 'out.raw'}"
    done = launch("--processes", "auto", "--stats=json", f"{VIDEO} ! {WORK} ! {WORK} ! {tail}")
    assert done.exit_code == 0, done.stderr
    assert f"note: --processes auto: ( process=true {VIDEO} ! {WORK} ) ! {WORK} ! {tail}" in done.stderr
    assert (tmp_path / "out.raw").stat().st_size == 20 * 64 * 48
    assert '"process":"bin0"' in done.stdout
    assert shared == [2]


def test_a_file_of_several_lines_is_cut(launch: Callable[..., Result], tmp_path: Path) -> None:
    """Comments, variables and branches stay as they are."""
    file = tmp_path / "two.pipe"
    file.write_text(
        f"# work ! in two places\n{VIDEO}\n  ! {WORK}  # here\n  ! identity sleep-time=${{US}} ! tee name=t\n"
        "t. ! queue ! fakesink\nt. ! queue ! fakesink\n"
    )
    done = launch("--processes", "auto", "-f", str(file), "--set", "US=20000")
    assert done.exit_code == 0, done.stderr
    assert f"( process=true {VIDEO}\n  ! {WORK}  # here\n  ) ! identity sleep-time=${{US}}" in done.stderr


@pytest.mark.parametrize(
    "text",
    [
        "fakesrc num-buffers=20 ! identity sleep-time=9000 ! identity sleep-time=9000 ! fakesink",  # no video
        f"{VIDEO} ! {WORK} ! fakesink",
        f"( {VIDEO} ! {WORK} ) ! {WORK} ! fakesink",  # bins of the user stay
    ],
)
def test_nothing_is_cut_without_need(launch: Callable[..., Result], text: str) -> None:
    """The description runs as it is written."""
    done = launch("--processes", "auto", "-e", text)
    assert done.exit_code == 0, done.stderr
    assert "note: --processes auto: one process is best" in done.stderr


def test_a_failure_while_measuring_ends_the_command(launch: Callable[..., Result]) -> None:
    """Exit code 1, and the error once."""
    done = launch("--processes", "auto", f"{VIDEO} ! identity error-after=3 ! fakesink")
    assert done.exit_code == 1
    assert done.stderr.count("error: ") == 1


def test_no_element_writes_while_measuring(tmp_path: Path) -> None:
    """Also not one that is no sink."""
    graph = build(f"{VIDEO} ! stitch name=s location={tmp_path / 'mosaic.png'} ! fakesink", {})
    processes.leave_out_sinks(graph)
    assert graph.element("s").location is None


class Parallel(Transform):
    """Work of 8 ms, which its threads divide."""

    sink = src = "ANY"
    threads: int = Property(4, min=1)

    def transform(self, frame):
        time.sleep(0.008 / self.threads)
        return frame


def test_work_in_threads_of_an_element_is_measured(register) -> None:
    """As a decoder has them: the time that it keeps its caller waiting is a part only."""
    register(parallel=Parallel)
    pipeline = Pipeline.parse(f"{VIDEO} ! parallel ! fakesink")
    work, _, frames, _ = processes.measure(pipeline, ["videotestsrc0", "parallel0"])
    assert frames == 20
    assert work[1] >= 8_000_000 * frames


def test_what_a_queue_drops_is_work_that_was_not_done() -> None:
    """What is behind a queue that drops frames has less to do than it would have with all of them."""
    video = "videotestsrc num-buffers=40 ! video/x-raw, width=64, height=48, format=GRAY8"
    queue = "queue leaky=downstream max-size-buffers=1"
    text = f"{video} ! identity sleep-time=5000 ! {queue} ! identity sleep-time=20000 ! fakesink"
    heads = ["videotestsrc0", "capsfilter0", "identity0", "queue0", "identity1"]
    work, _, frames, _ = processes.measure(Pipeline.parse(text), heads)
    assert frames == 40
    assert work[4] >= 20_000_000 * 39


def test_a_live_pipeline_that_drops_nothing_stays_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """However its work could be divided: it cannot get faster than its source."""
    monkeypatch.setattr(processes, "MEASURE_S", 2.0)
    text = (
        VIDEO.replace("num-buffers=20", "is-live=true") + ", framerate=10/1 ! identity ! identity ! fakesink"
    )
    heads = ["videotestsrc0", "capsfilter0", "identity0", "identity1"]
    _, _, frames, present = processes.measure(Pipeline.parse(text), heads)
    assert present == 0.0
    assert frames > 0


def test_what_threads_of_its_own_already_do_is_no_gain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two like parts with a queue between them, the time together is that of one."""
    text = VIDEO.replace("=20 ", "=100 ") + f" ! {WORK} ! queue ! {WORK} ! fakesink"
    monkeypatch.setattr(processes, "MEASURE_S", 2.0)
    heads = ["videotestsrc0", "capsfilter0", "identity0", "queue0", "identity1"]
    work, _, _, present = processes.measure(Pipeline.parse(text), heads)
    assert present < 0.75 * sum(work)


def test_what_is_chosen_is_a_line_of_the_log(launch: Callable[..., Result]) -> None:
    """With --log-format json every line on stderr is a JSON object."""
    done = launch("--log-format", "json", "--processes", "auto", f"{VIDEO} ! {WORK} ! fakesink")
    lines = [json.loads(line) for line in done.stderr.splitlines()]
    assert {"level": "note", "message": "--processes auto: one process is best"}.items() <= lines[0].items()


def test_a_failure_while_measuring_is_a_line_of_the_log(launch: Callable[..., Result]) -> None:
    """The command ends with code 1."""
    done = launch(
        "--log-format", "json", "--processes", "auto", f"{VIDEO} ! identity error-after=3 ! fakesink"
    )
    assert done.exit_code == 1
    assert json.loads(done.stderr)["level"] == "error"


@pytest.mark.parametrize(
    ("work", "cuts", "cores", "crossing", "wanted"),
    [
        ([4, 4], [1], 2, 0.0, [1]),
        ([1, 1, 1, 3], [1, 2, 3], 2, 0.0, [3]),
        ([1, 1, 1, 3], [1, 2], 2, 0.0, [2]),  # not where it is not allowed
        ([2, 2, 2], [1, 2], 3, 0.0, [1, 2]),
        ([2, 2, 2], [1, 2], 2, 0.0, [1]),
        ([4, 4], [1], 1, 0.0, []),
        ([4, 4], [1], 2, 4.0, []),  # crossing costs what the cut saves
        ([10, 0.9], [1], 2, 0.0, []),  # saves less than a tenth
        ([10, 1.2], [1], 2, 0.0, [1]),
        ([5, 5, 0, 0], [1, 2, 3], 4, 0.0, [1]),  # no more processes than help
        ([0, 0], [1], 2, 0.0, []),
        ([3], [], 8, 0.0, []),
    ],
)
def test_cuts(work: list[float], cuts: list[int], cores: int, crossing: float, wanted: list[int]) -> None:
    """The busiest process has as little to do as possible, with as few processes as that needs."""
    assert processes.balanced_cuts(work, cuts, cores, crossing) == wanted


def test_a_cut_has_to_save_a_tenth_of_the_present_time() -> None:
    """A pipeline with threads of its own may be as fast already."""
    assert processes.balanced_cuts([4, 4], [1], 2, 0.0, 4.4) == []
    assert processes.balanced_cuts([4, 4], [1], 2, 0.0, 4.5) == [1]
