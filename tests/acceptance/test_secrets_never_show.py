"""A password in any text property of any element shows in nothing that leaves the process."""

import contextlib
import json
import logging
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from streamkit import Pipeline
from streamkit.cli.graph import Counters, as_dot, as_mermaid
from streamkit.cli.graph import graph as graph_command
from streamkit.cli.main import make_app
from streamkit.element.registry import available_elements, element_class, make_element
from streamkit.errors import DescriptionError
from streamkit.graph.build import build

SECRET = "hunter2"
FORMS = {
    "slash": f"rtsp://user:{SECRET}/{SECRET}@127.0.0.1:9/live",
    "hash": f"rtsp://user:{SECRET}#{SECRET}@127.0.0.1:9/live",
    "question": f"http://user:{SECRET}?{SECRET}@127.0.0.1:9/live",
    "blank": f"rtsp://user:{SECRET} {SECRET}@127.0.0.1:9/live",
    "at": f"tcp://user:{SECRET}@{SECRET}@127.0.0.1:9",
    "path": f"rtsp://127.0.0.1:9/user=admin_password={SECRET}_channel=1_stream=0.sdp",
    "query": f"http://127.0.0.1:9/video?user=admin&password={SECRET}&size=2",
    "no-scheme": f"user:{SECRET}@127.0.0.1:9/live",
    "one-slash": f"rtsp:/user:{SECRET}/{SECRET}@127.0.0.1:9/live.mp4",
}
VIDEO = "videotestsrc num-buffers=2 ! video/x-raw, format=GRAY8, width=64, height=64"
PACKETS = {"packetsink", "remux", "rtspclientsink", "decode"}
UNLINKED = {"appsrc", "telemetryparse"}  # take and give nothing here: started by themselves only
RUN_LIMIT_S = 3.0


def text_properties(factory: str) -> list[str]:
    """The properties of an element that take any text."""
    known = element_class(factory).properties.values()
    return [item.spelling for item in known if item.kind is str and not item.readonly]


ELEMENTS = [name for name in available_elements() if text_properties(name)]


def description(factory: str, assignment: str) -> str:
    """A pipeline with the element in it."""
    known = element_class(factory).pad_templates.values()
    directions = {str(template.direction) for template in known}
    ends = "num-buffers=2 " if "num_buffers" in element_class(factory).properties else ""
    text = f"{factory} {ends}{assignment}"
    if "sink" in directions:
        text = f"{VIDEO}{' ! encode' if factory in PACKETS else ''} ! {text}"
    return f"{text} ! fakesink" if "src" in directions else text


def everything_shown(text: str) -> Iterator[str]:
    """What building, drawing and running a pipeline lets out."""
    try:
        pipeline = Pipeline.parse(text)
    except DescriptionError as error:
        yield from (str(error), repr(error), error.pointed(text), error.message, error.hint)
        return
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(pipeline)
            pipeline.run(timeout_s=RUN_LIMIT_S)
        except Exception as error:
            yield from (str(error), repr(error))
        yield repr(pipeline.statistics())
        yield repr(pipeline.graph) + repr([element.pads for element in pipeline.graph.elements])
        while (message := pipeline.bus.pop(0.0)) is not None:
            yield repr(message) + str(message.error)


def started_alone(factory: str, name: str, value: str) -> Iterator[str]:
    """What an element says that is started without a pipeline."""
    element = make_element(factory)
    said: list[object] = []
    element.poster = said.append
    try:
        element.set_property(name, value)
        element.start()
    except Exception as error:
        yield from (str(element.failure(error)), repr(element.failure(error)))
    finally:
        element.stopping.set()
        element.stop()
    yield repr(element) + repr(said) + json.dumps(element.properties_set())


def drawn(text: str) -> Iterator[str]:
    """The drawings of a description; what `streamkit graph` prints of it is in the output of the test."""
    with contextlib.suppress(typer.Exit):
        graph_command([text], form="json")
    with contextlib.suppress(DescriptionError):
        graph = build(text, {})
        yield from (as_dot(graph, Counters()), as_mermaid(graph, Counters()))


def quoted(value: str) -> str:
    """A value as a description takes it."""
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


@pytest.mark.timeout(300)
@pytest.mark.parametrize("factory", ELEMENTS)
def test_a_secret_shows_nowhere(
    factory: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Errors, messages, statistics, graphs, reprs, logs, the terminal and what is written hold none of it."""
    monkeypatch.chdir(tmp_path)
    caplog.set_level(logging.DEBUG)
    shown: list[tuple[str, str]] = []
    for name in text_properties(factory):
        for form, value in FORMS.items():
            text = description(factory, f"{name}={quoted(value)}")
            said = [*started_alone(factory, name, value), *drawn(text)]
            if factory not in UNLINKED:
                said += everything_shown(text)
            shown += [(f"{name} {form}", line) for line in said]
    leaks = [(where, line) for where, line in shown if SECRET in line]
    assert not leaks
    out, err = capfd.readouterr()
    assert '"factory"' in out or '"error"' in err or not shown
    assert SECRET not in out + err + caplog.text
    written = [
        path for path in tmp_path.rglob("*") if path.is_file() and SECRET.encode() in path.read_bytes()
    ]
    assert not written


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("as_json", [False, True])
def test_the_doctor_shows_no_secret(form: str, as_json: bool) -> None:
    """Neither in its checks nor in the pipeline that it proposes."""
    words = ["doctor", FORMS[form], "--timeout", "0.5", "--seconds", "0.5", *(["--json"] if as_json else [])]
    result = CliRunner().invoke(make_app(), words)
    assert result.exit_code == 1
    assert result.output
    assert SECRET not in result.output


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("element", ["filesrc", "multifilesrc", "rtspsrc", "nosuchsrc"])
def test_launch_shows_no_secret(form: str, element: str, tmp_path: Path) -> None:
    """Quoted or not: in errors as text and as JSON, with -v, in statistics, on both outputs."""
    statistics = tmp_path / "statistics.json"
    for value in (FORMS[form], quoted(FORMS[form])):
        for options in (
            ["-v", "--stats"],
            ["--json-errors"],
            ["--stats=json", "--stats-file", str(statistics)],
        ):
            words = ["launch", *options, f"{element} location={value} ! fakesink"]
            result = CliRunner().invoke(make_app(), words)
            assert result.exit_code in (1, 2)
            assert SECRET not in result.output + result.stderr
    assert not statistics.exists() or SECRET not in statistics.read_text(encoding="utf-8")
