"""Run: what is printed while a pipeline starts, and how signals count."""

from __future__ import annotations

import math
import signal
import threading

import pytest

from streamkit import Pipeline
from streamkit.cli import run as module
from streamkit.cli.crash_report import CrashReport
from streamkit.cli.display import Display
from streamkit.cli.run import Run
from streamkit.service.monitor import Monitor


def test_a_warning_of_the_start_is_printed_while_it_starts_and_once(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compiling takes minutes: the user sees why nothing happens."""
    pipeline = Pipeline.parse("fakesrc num-buffers=1 ! fakesink name=slow")
    slow = pipeline["slow"]
    during: list[str] = []

    def start() -> None:
        slow.post_warning("loops are being compiled")
        during.append(capsys.readouterr().err)

    monkeypatch.setattr(slow, "start", start)
    run = Run(pipeline, Display(pipeline), eos_on_shutdown=False, verbose=False, quiet=False)
    assert run.run() == 0
    assert during == ["warning: slow: loops are being compiled\n"]
    assert "compiled" not in capsys.readouterr().err


def test_what_is_counted_while_elements_stop_is_in_the_statistics(monkeypatch: pytest.MonkeyPatch) -> None:
    """An interrupted encoder drops frames in `stop`; a mosaic becomes a file there."""
    pipeline = Pipeline.parse("fakesrc num-buffers=3 ! fakesink name=slow")
    slow = pipeline["slow"]
    monkeypatch.setattr(slow, "stop", lambda: slow.count_drop("held at the stop", 2))
    run = Run(pipeline, Display(pipeline), eos_on_shutdown=False, verbose=False, quiet=True)
    assert run.run() == 0
    assert run.statistics is not None
    assert run.statistics.elements[1].dropped == {"held at the stop": 2}
    assert run.statistics.elements[1].frames_in == 3


def test_the_end_of_the_stream_does_not_wait_for_a_beat() -> None:
    """A message wakes the loop, however rare its beats are."""
    pipeline = Pipeline.parse("fakesrc num-buffers=3 ! fakesink")
    run = Run(pipeline, Display(pipeline), eos_on_shutdown=False, verbose=False, quiet=True, beat_s=math.inf)
    assert run.run() == 0


def test_an_interrupt_from_another_thread_is_noticed_at_the_next_beat() -> None:
    """The thread that runs the pipeline ends it."""
    pipeline = Pipeline.parse("fakesrc is-live=true ! fakesink")
    beats = 0

    class Beating(Monitor):
        def beat(self) -> None:
            nonlocal beats
            beats += 1
            if beats == 3:
                threading.Thread(target=run.interrupt).start()

    run = Run(
        pipeline,
        Display(pipeline),
        eos_on_shutdown=False,
        verbose=False,
        quiet=True,
        monitor=Beating(pipeline),
        beat_s=0.01,
    )
    assert run.run() == 0
    assert run.interrupts == 1
    assert beats >= 3


def test_an_interrupt_while_the_crash_report_begins_stops_cleanly(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It starts a process, which takes some time; "the process has died" was printed, with exit code 130."""

    def interrupted(*arguments: object, **options: object) -> CrashReport:
        signal.raise_signal(signal.SIGINT)
        return CrashReport(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "CrashReport", interrupted)
    pipeline = Pipeline.parse("fakesrc ! fakesink")
    assert Run(pipeline, Display(pipeline), eos_on_shutdown=False, verbose=False, quiet=False).run() == 0
    assert "interrupt: stopped before it played" in capsys.readouterr().err


def test_signals_at_once_count_as_one_interrupt(monkeypatch: pytest.MonkeyPatch) -> None:
    """`timeout` signals the process and its group: with -e, the stream still ends in order."""
    pipeline = Pipeline.parse("fakesrc ! fakesink")
    run = Run(pipeline, Display(pipeline), eos_on_shutdown=True, verbose=False, quiet=True)
    report = CrashReport(pipeline.graph.elements)
    monkeypatch.setattr(module, "SAME_INTERRUPT_S", 60.0)
    try:
        with run._signals(report):
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            assert run.interrupts == 1
            run._print_interrupt("ending the stream")
            signal.raise_signal(signal.SIGTERM)
        assert run.interrupts == 2
    finally:
        report.close()


def test_the_end_of_the_stream_may_take_as_long_as_the_watchdog_allows(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """With -e a mosaic is finished after Ctrl-C, within the limit that `--watchdog-s` allows."""
    pipeline = Pipeline.parse("fakesrc ! queue ! identity sleep-time=100000 ! fakesink", watchdog_s=1.0)
    run = Run(pipeline, Display(pipeline), eos_on_shutdown=True, verbose=False, quiet=True)
    timer = threading.Timer(0.5, run.interrupt)
    timer.start()
    assert run.run() == 1
    timer.join()
    assert "error: EOS did not arrive within 1 s of the interrupt; allow more by --watchdog-s" in (
        capsys.readouterr().err
    )
