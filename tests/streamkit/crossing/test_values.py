"""Values keep type and content; what has no form is refused by name."""

import enum
from dataclasses import dataclass, field

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit import Caps, FeatureSpace, Registration
from streamkit.crossing.values import CannotCross, ValueDecoder, ValueEncoder
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit.geometry.track import Track, TrackState

TESTS = __name__.partition(".")[0]


class Colour(enum.Enum):
    RED = 1


class Kinds(enum.Flag):
    A = 1
    B = 2


@dataclass(frozen=True)
class Point:
    x: float
    y: float
    note: str = field(default="", init=False)


def there_and_back(value: object) -> object:
    """The value as another process has it."""
    message = msgspec.msgpack.encode(ValueEncoder().encode(value))
    return ValueDecoder({TESTS}).decode(msgspec.msgpack.decode(message))


leaves = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats(allow_nan=False)
    | st.text()
    | st.binary()
    | st.fractions()
    | st.sampled_from([Caps("video/x-raw, format={ GRAY8, BGR }"), np.float32(1.5), np.int64(-3)])
)


@settings(max_examples=60)
@given(st.recursive(leaves, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=20))
def test_plain_values_keep_type_and_content(value: object) -> None:
    """Numbers, texts, containers."""
    assert there_and_back(value) == value


@pytest.mark.parametrize("value", [(1, (2,), [3]), {1, 2}, frozenset({"a"}), np.float64(0.1), np.bool_(True)])
def test_containers_and_scalars_keep_their_type(value: object) -> None:
    """A tuple is no list, and a NumPy scalar no number of Python."""
    found = there_and_back(value)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("is_writable", [True, False])
def test_arrays_keep_order_and_flag(order: str, is_writable: bool) -> None:
    """The order of memory decides the last bit of a matrix product; the flag, which function is compiled."""
    array = np.asarray(np.arange(6.0).reshape(2, 3), order=order)
    array.flags.writeable = is_writable
    found = there_and_back(array)
    assert isinstance(found, np.ndarray)
    assert np.array_equal(found, array)
    assert found.flags.f_contiguous == array.flags.f_contiguous
    assert found.flags.writeable == is_writable


def test_metadata_of_the_vocabulary_crosses() -> None:
    """Dataclasses with arrays, enumerations and other dataclasses."""
    registration = there_and_back(Registration(np.eye(3), np.eye(3), status=RegistrationStatus.WEAK))
    assert isinstance(registration, Registration)
    assert registration.status is RegistrationStatus.WEAK
    track = Track(1, TrackState.LOST, 1.0, 2.0, 3.0, 4.0, 0.1, (1.0, 2.0), np.eye(2), 0.5, 7)
    found = there_and_back(track)
    assert isinstance(found, Track)
    assert found.velocity == (1.0, 2.0)
    assert there_and_back(FeatureSpace) is FeatureSpace


def test_objects_of_a_package_of_the_graph_cross() -> None:
    """A dataclass anywhere in a package that has an element in the graph."""
    assert ValueDecoder({TESTS}).decode(ValueEncoder().encode([Colour.RED, Kinds.A | Kinds.B])) == [
        Colour.RED,
        Kinds.A | Kinds.B,
    ]


@pytest.mark.parametrize("value", [object(), lambda: 1, np.array([object()]), [{1: iter(())}]])
def test_other_objects_are_refused(value: object) -> None:
    """The error names the type and the remedy."""
    with pytest.raises(CannotCross, match=r"cannot reach another process: make it a dataclass"):
        ValueEncoder().encode(value)


@pytest.mark.parametrize(
    "item",
    [
        [7, "os:stat_result", 1],
        [7, "subprocess:Popen", "true"],
        [8, "enum:Enum", 1],
        [7, "streamkit.graph.pipeline:Pipeline", 1],
        [7, "streamkit.nothing:Nothing"],
        [5, "|O", [1], "C", False, b"12345678"],
    ],
)
def test_a_process_cannot_have_just_anything_made(item: list[object]) -> None:
    """Only dataclasses, structs and enumerations, of packages with elements in the graph."""
    with pytest.raises(CannotCross):
        ValueDecoder().decode(item)


@pytest.mark.parametrize(
    "item", [[], ["x"], [99], [0.5], [5, "<f8", [3], "C", False, b""], [9, 1, 0], [4, [1, []]]]
)
def test_what_cannot_be_read_is_a_value_error(item: list[object]) -> None:
    """Whatever the other process sends."""
    with pytest.raises((ValueError, CannotCross)):
        ValueDecoder().decode(item)
