"""Run: what is printed while a pipeline starts."""

from __future__ import annotations

import pytest

from streamkit import Pipeline
from streamkit.cli.display import Display
from streamkit.cli.run import Run


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
