"""Caps: the algebra that negotiation rests on."""

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit import ANY, Caps, Structure
from streamkit.flow.caps import EMPTY
from streamkit.flow.caps_values import FloatRange, FractionRange, IntRange, Value, ValueArray, ValueList

RAW = "video/x-raw, format={ GRAY8, BGR }, width=[ 1, 4096 ]"

finite_floats = st.floats(allow_nan=False, allow_infinity=False)
fractions = st.fractions(min_value=-1000, max_value=1000, max_denominator=1001)
plain_values = st.one_of(
    st.integers(-(2**31), 2**31 - 1),
    st.integers(0, 8),
    finite_floats,
    st.booleans(),
    fractions,
    st.text(max_size=6),
    st.binary(max_size=4),
)
int_ranges = st.tuples(st.integers(-9, 9), st.integers(1, 9), st.integers(1, 4)).map(
    lambda t: IntRange(t[0] * t[2], (t[0] + t[1]) * t[2], t[2])
)
float_ranges = (
    st.tuples(finite_floats, finite_floats)
    .filter(lambda pair: pair[0] != pair[1])
    .map(lambda pair: FloatRange(min(pair), max(pair)))
)
fraction_ranges = (
    st.tuples(fractions, fractions)
    .filter(lambda pair: pair[0] != pair[1])
    .map(lambda pair: FractionRange(min(pair), max(pair)))
)
single_values = st.one_of(plain_values, int_ranges, float_ranges, fraction_ranges)
values: st.SearchStrategy[Value] = st.one_of(
    single_values,
    st.lists(single_values, min_size=1, max_size=4).map(lambda items: ValueList(tuple(items))),
    st.lists(single_values, min_size=1, max_size=3).map(lambda items: ValueArray(tuple(items))),
)
structures = st.builds(
    Structure,
    st.sampled_from(["video/x-raw", "audio/x-raw"]),
    st.dictionaries(st.sampled_from(["format", "width", "framerate"]), values, max_size=3),
    st.sampled_from([(), ("memory:A",), ("ANY",)]),
)
all_caps = st.lists(structures, max_size=3).map(Caps) | st.sampled_from([ANY, EMPTY])
sampled = settings(max_examples=60, deadline=None, derandomize=True)


@given(all_caps)
@sampled
def test_text_and_back(caps: Caps) -> None:
    """What is written reads as the same caps."""
    assert Caps(str(caps)) == caps


@given(all_caps, all_caps)
@sampled
def test_intersection_is_commutative_and_within_both(a: Caps, b: Caps) -> None:
    """As sets a & b is b & a, and a subset of either."""
    assert a & b == b & a
    assert a & b <= a
    assert a & b <= b


@given(all_caps, all_caps)
@sampled
def test_union_contains_both(a: Caps, b: Caps) -> None:
    """Nothing is lost by joining caps."""
    assert a <= a | b
    assert b <= a | b


@given(all_caps, all_caps)
@sampled
def test_fixation_gives_one_format_of_the_caps(caps: Caps, near: Caps) -> None:
    """What is picked is fixed and allowed, whatever is wished for."""
    if not caps.structures:
        assert caps.fixate(near) == caps
        return
    fixed = caps.fixate(near)
    assert fixed.is_fixed
    assert fixed <= caps


@given(all_caps)
@sampled
def test_equal_caps_have_equal_hashes(caps: Caps) -> None:
    """Caps that are equal as sets meet in a dict, in whatever order they were written."""
    turned = caps if caps.is_any else Caps(tuple(reversed(caps.structures)))
    assert turned == caps
    assert hash(turned) == hash(caps)


def test_any_and_empty() -> None:
    """ANY meets everything, EMPTY nothing; neither is fixed."""
    raw = Caps(RAW)
    assert ANY & raw == raw == raw & ANY
    assert (EMPTY & raw).is_empty
    assert ANY | raw == ANY
    assert EMPTY <= raw <= ANY
    assert not raw >= ANY
    assert not ANY.is_fixed
    assert not EMPTY
    assert [ANY.name, EMPTY.name, raw.name] == ["ANY", "EMPTY", "video/x-raw"]
    assert Caps() == EMPTY


def test_order_is_preference() -> None:
    """The order of the left side rules, of structures and of list entries."""
    wanted = Caps("video/x-raw, format={ NV12, GRAY8 }; video/x-h264")
    offered = Caps("video/x-h264; video/x-raw, format={ GRAY8, NV12 }")
    assert str(wanted & offered) == "video/x-raw, format=(string){ NV12, GRAY8 }; video/x-h264"


def test_a_missing_field_means_any_value() -> None:
    """Caps without a field are the wider ones."""
    assert Caps("video/x-raw, width=320") <= Caps("video/x-raw")
    assert not Caps("video/x-raw") <= Caps("video/x-raw, width=320")


def test_features_keep_caps_apart() -> None:
    """Other features never meet; `ANY` meets all and takes the other's."""
    plain, mapped, every = (Caps(f"video/x-raw{text}") for text in ("", "(memory:DMABuf)", "(ANY)"))
    assert (plain & mapped).is_empty
    assert every & mapped == mapped == mapped & every
    assert mapped <= every
    assert not every <= mapped


def test_reading_fields() -> None:
    """Fields are those of the first structure; a missing one is named with the caps."""
    caps = Caps("video/x-raw, width=320, live=true, framerate=30/1")
    assert caps["width"] == 320
    assert caps.get("height", 7) == 7
    assert caps.get("framerate") == Fraction(30)
    assert caps.integer("width") == 320
    assert EMPTY.get("width") is None
    with pytest.raises(KeyError, match="have no field 'height'"):
        caps["height"]
    with pytest.raises(KeyError, match=r"field 'live' of caps .* must be one integer"):
        caps.integer("live")


def test_fields_set_and_left_out() -> None:
    """Both give new caps; without a field any value of it is allowed."""
    caps = Caps("video/x-raw, format=GRAY8, width=320; video/x-raw, format=BGR, width=320")
    assert all(structure.fields["width"] == 640 for structure in caps.with_fields(width=640).structures)
    assert caps.without_fields("format") == Caps("video/x-raw, width=320")
    assert ANY.without_fields("format") is ANY
    assert caps["width"] == 320


@pytest.mark.parametrize(
    ("offered", "accepted", "field"),
    [
        ("video/x-raw, width=1", "video/x-h264", "media type"),
        ("video/x-raw, width=1", "video/x-raw, width=2", "width"),
        ("video/x-raw, width=1", "video/x-h264; video/x-raw, width=[ 2, 3 ]", "width"),
        ("video/x-raw(memory:A)", "video/x-raw", "features"),
    ],
)
def test_the_field_in_conflict_is_named(offered: str, accepted: str, field: str) -> None:
    """Error texts name the field, or the media type where that differs."""
    assert Caps(offered).conflict(Caps(accepted)) == field


def test_fixation_stays_near_what_comes_in() -> None:
    """Each field takes the wished value where it may, else the nearest."""
    allowed = Caps("video/x-raw, format={ BGR, GRAY8 }, width=[ 16, 256 ], height=[ 16, 256 ]")
    near = Caps("video/x-raw, format=GRAY8, width=640, height=64")
    assert str(allowed.fixate(near)) == "video/x-raw, format=(string)GRAY8, width=(int)256, height=(int)64"


def test_caps_compare_with_caps_only() -> None:
    """A text is no caps: comparison does not guess."""
    assert Caps("a/b") != "a/b"
    assert repr(Caps("a/b")) == "Caps('a/b')"
    assert Caps(Caps("a/b")) == Caps("a/b")


def test_structures_are_equal_whatever_the_order_of_their_fields() -> None:
    """Fields are a set; a type that differs makes another structure."""
    one = Structure("a/b", {"x": 1, "y": 2})
    assert one.equal(Structure("a/b", {"y": 2, "x": 1}))
    assert not one.equal(Structure("a/b", {"x": 1.0, "y": 2}))
