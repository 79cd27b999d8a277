"""The elements of the tutorial on several pads do what it says."""

import importlib
import re
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest

from streamkit import Frame, Pipeline, raw_video_caps
from streamkit.testing import Harness

TEXT = (Path(__file__).parents[2] / "docs" / "tutorial-several-pads.md").read_text(encoding="utf-8")


@pytest.fixture(autouse=True)
def elements(register: Callable[..., None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The elements of the page, under their names."""
    (listing,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    (tmp_path / "several_pads.py").write_text(listing, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("several_pads")
    register(glare=module.Glare, subtractlatest=module.SubtractLatest)


def test_the_commands_run(
    call: Callable[[Sequence[str], Path], CompletedProcess[str]], tmp_path: Path
) -> None:
    """And the mask is a film."""
    (commands,) = re.findall(r"```sh\n(.*?)```", TEXT, re.DOTALL)
    for line in commands.splitlines():
        done = call(shlex.split(line)[1:], tmp_path)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "mask.mp4").stat().st_size > 500


def grey(*pixels: int) -> Frame:
    """A frame with one row."""
    return Frame(np.array([pixels], np.uint8), raw_video_caps("GRAY8", len(pixels), 1))


def test_the_mask_shows_what_the_frame_lacks() -> None:
    """Both come from the same frame."""
    text = "appsrc name=in ! glare limit=100 name=g ! appsink name=out  g.mask ! appsink name=mask"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        pipeline["in"].push(grey(50, 150))
        pipeline["in"].end()
        out, mask = list(pipeline["out"]), list(pipeline["mask"])
    assert [frame.data.tolist() for frame in out] == [[[50, 100]]]
    assert [frame.data.tolist() for frame in mask] == [[[0, 255]]]


def test_frames_before_a_background_are_counted() -> None:
    """After it they are differences."""
    with Harness("subtractlatest") as harness:
        assert harness.push(grey(9, 9)) == []
        assert harness.element.drops == {"no background of this size": 1}
