"""zenohsink control=true: live properties are listed and set over zenoh, and every refusal says why."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest
import zenoh

from streamkit import MessageKind, Pipeline, PropertyError
from streamkit_zenoh.wire.messages import ControlReply, StatusRecord, read_request

Ask = Callable[..., list[ControlReply]]
LAUNCH = (
    "videotestsrc is-live=true ! framediff name=moving ! queue name=q ! particletrack name=tracker "
    "! zenohsink key={key} listen={endpoint} control=true"
)


@pytest.fixture
def pipeline(key: str, endpoint: str) -> Iterator[Pipeline]:
    """A pipeline that can be controlled."""
    with Pipeline.parse(LAUNCH.format(key=key, endpoint=endpoint)) as running:
        running.play()
        yield running


@pytest.fixture
def ask(key: str, endpoint: str, pipeline: Pipeline, open_test_session: Callable[..., zenoh.Session]) -> Ask:
    """Queries KEY/control; gives the replies."""
    session = open_test_session(connect=endpoint)

    def asked(request: object = None, at: str = f"{key}/control") -> list[ControlReply]:
        payload = request if isinstance(request, bytes) or request is None else json.dumps(request)
        replies = session.get(at, payload=payload, timeout=10.0)
        samples = [reply.ok for reply in replies if reply.ok is not None]
        return [
            msgspec.json.decode(sample.payload.to_bytes(), type=ControlReply)
            for sample in samples
            if "control" in str(sample.encoding)
        ]

    return asked


def change(element: str, name: str, value: Any) -> dict[str, Any]:
    """A request."""
    return {"element": element, "property": name, "value": value}


def test_live_properties_are_listed_with_what_they_take(pipeline: Pipeline, ask: Ask) -> None:
    """Others, such as the key, are not."""
    (reply,) = ask()
    found = {(item.element, item.property): item for item in reply.properties}
    score = found["moving", "min-score"]
    assert (score.type, score.value, score.minimum, score.maximum) == ("float", 0.0, 0.0, 1.0)
    assert found["q", "leaky"].choices == ("no", "upstream", "downstream")
    assert found["tracker", "window"].unit == "px"
    assert not any(name == "key" for _, name in found)


def test_a_change_is_in_the_element_on_the_bus_and_in_the_status(
    pipeline: Pipeline, ask: Ask, key: str, endpoint: str, open_test_session: Callable[..., zenoh.Session]
) -> None:
    """The reply has the new value."""
    (reply,) = ask(change("moving", "min-score", "0.5"))
    assert reply.error is None
    assert [item.value for item in reply.properties] == [0.5]
    assert pipeline["moving"].min_score == 0.5
    message = pipeline.bus.pop(10.0, (MessageKind.ELEMENT,))
    while message is not None and message.text != "property-set":
        message = pipeline.bus.pop(10.0, (MessageKind.ELEMENT,))
    assert message is not None
    assert message.source == "moving"
    assert message.fields["value"] == "0.5"
    (found,) = open_test_session(connect=endpoint).get(f"{key}/status", timeout=10.0)
    assert found.ok is not None
    status = msgspec.json.decode(found.ok.payload.to_bytes(), type=StatusRecord)
    assert status.control
    assert [(item.property, item.value) for item in status.changes] == [("min-score", "0.5")]


def test_a_window_starts_a_target(pipeline: Pipeline, ask: Ask) -> None:
    """As the property does; a malformed one is refused with the property's own error."""
    (reply,) = ask(change("tracker", "window", "10,10,40,40"))
    assert reply.error is None
    with pytest.raises(PropertyError) as refused:
        pipeline["tracker"].window = "1,2"
    (reply,) = ask(change("tracker", "window", "1,2"))
    assert reply.error == str(refused.value)
    assert pipeline["tracker"].window == "10,10,40,40"


@pytest.mark.parametrize(
    ("request_", "error"),
    [
        (change("moving", "min-score", 2), "property min-score cannot be 2.0: it takes float 0.0..1.0"),
        (change("moving", "min-score", "much"), "it takes a number such as 0.5 or 1e3"),
        (change("moving", "min-scor", 1), 'did you mean "min-score"'),
        (change("moved", "min-score", 1), "no element 'moved' in the pipeline"),
        (change("zenohsink0", "key", "uav/2"), "property key cannot change while playing"),
        ({"element": "moving"}, "missing required field `property`"),
        ({"moving": {"min-score": 1}}, 'write {"element": NAME, "property": NAME, "value": VALUE}'),
        (b"\xff", "invalid"),
        (b'{"a":' + b"[" * 3000, "unknown field"),
        (b" " * 5000, "at most 4096 bytes, got 5000"),
    ],
)
def test_a_refusal_says_why(pipeline: Pipeline, ask: Ask, request_: object, error: str) -> None:
    """Nothing is set then."""
    (reply,) = ask(request_)
    assert reply.error is not None
    assert error in reply.error
    assert not reply.properties


def test_a_request_to_all_publishers_is_refused(pipeline: Pipeline, ask: Ask) -> None:
    """A wildcard may list properties, and sets none."""
    (reply,) = ask(change("moving", "min-score", 0.5), at="test/**")
    assert "names one publisher" in str(reply.error)
    assert pipeline["moving"].min_score == 0.0


def test_without_control_there_is_no_queryable(
    key: str, endpoint: str, open_test_session: Callable[..., zenoh.Session]
) -> None:
    """It is off by default."""
    with Pipeline.parse(f"videotestsrc is-live=true ! zenohsink key={key} listen={endpoint}") as running:
        running.play()
        session = open_test_session(connect=endpoint)
        assert [reply for reply in session.get(f"{key}/status", timeout=10.0) if reply.ok]
        assert not [reply for reply in session.get(f"{key}/control", timeout=10.0) if reply.ok]


def test_five_thousand_hostile_requests_raise_value_errors_only() -> None:
    """The reader of requests refuses or reads them."""
    numbers = random.Random(22)
    good = json.dumps(change("moving", "min-score", 0.5)).encode()
    for _ in range(5000):
        data = bytearray(good)
        for _ in range(numbers.randrange(1, 8)):
            data[numbers.randrange(len(data))] = numbers.randrange(256)
        try:
            request = read_request(bytes(data[: numbers.randrange(len(data) + 1)]))
        except ValueError:
            continue
        assert isinstance(request.element, str)
