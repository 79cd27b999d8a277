"""Laws of the algebra of caps, with caps of every type."""

from __future__ import annotations

from datetime import date
from fractions import Fraction

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from streamkit import ANY, Caps, Structure
from streamkit.errors import CapsSyntax, CapsTooLarge
from streamkit.flow.caps import EMPTY
from streamkit.flow.caps_values import (
    Bitmask,
    FlagSet,
    Float32,
    FloatRange,
    FractionRange,
    Int64,
    Int64Range,
    IntRange,
    UInt,
    Value,
    ValueArray,
    ValueList,
)

finite_floats = st.floats(allow_nan=False, allow_infinity=False)
few_floats = st.sampled_from([-1.0, 0.0, 0.5, 1.0, 1.5, 2.0])
fractions = st.fractions(min_value=-1000, max_value=1000, max_denominator=1001) | st.sampled_from(
    [Fraction(1, 2), Fraction(1), Fraction(30), Fraction(30000, 1001)]
)
plain_values: st.SearchStrategy[Value] = st.one_of(
    st.integers(-(2**31), 2**31 - 1),
    st.integers(0, 8),
    st.integers(0, 8),
    st.integers(0, 8).map(Int64),
    st.integers(0, 3).map(UInt),
    st.integers(0, 3).map(Bitmask),
    finite_floats,
    few_floats,
    st.sampled_from([Float32(0.5), Float32(1.0)]),
    st.booleans(),
    fractions,
    st.text(max_size=6),
    st.sampled_from(["x", "y", "NULL"]),
    st.binary(max_size=4),
    st.dates(min_value=date(2020, 1, 1), max_value=date(2020, 1, 3)),
    st.builds(FlagSet, st.integers(0, 15), st.integers(0, 15)),
)
bounds = st.tuples(st.integers(-9, 9), st.integers(1, 9), st.integers(1, 4))
int_ranges = bounds.map(lambda t: IntRange(t[0] * t[2], (t[0] + t[1]) * t[2], t[2]))
wide_ranges = bounds.map(lambda t: Int64Range(Int64(t[0] * t[2]), Int64((t[0] + t[1]) * t[2]), t[2]))
float_ranges = (
    st.tuples(finite_floats | few_floats, few_floats)
    .filter(lambda pair: pair[0] != pair[1])
    .map(lambda pair: FloatRange(min(pair), max(pair)))
)
fraction_ranges = (
    st.tuples(fractions, fractions)
    .filter(lambda pair: pair[0] != pair[1])
    .map(lambda pair: FractionRange(min(pair), max(pair)))
)
single_values = st.one_of(plain_values, int_ranges, wide_ranges, float_ranges, fraction_ranges)
flat_values: st.SearchStrategy[Value] = st.one_of(
    single_values,
    st.lists(single_values, min_size=1, max_size=4).map(lambda items: ValueList(tuple(items))),
    st.lists(single_values, min_size=1, max_size=3).map(lambda items: ValueArray(tuple(items))),
)


def structures_of(values: st.SearchStrategy[Value], names: list[str]) -> st.SearchStrategy[Structure]:
    """Structures with few names and fields, so that they often meet."""
    return st.builds(
        Structure,
        st.sampled_from(names),
        st.dictionaries(st.sampled_from(["format", "width", "framerate"]), values, max_size=3),
        st.sampled_from([(), (), ("memory:A",), ("memory:A", "meta:B"), ("ANY",)]),
    )


nested = structures_of(flat_values, ["s", "t"]).map(lambda s: Structure(s.name, s.fields))
values: st.SearchStrategy[Value] = st.one_of(
    flat_values,
    flat_values,
    st.lists(flat_values, min_size=1, max_size=3).map(lambda items: ValueList(tuple(items))),
    nested,
    st.lists(nested, min_size=1, max_size=2).map(lambda items: ValueList(tuple(items))),
)
structures = structures_of(values, ["video/x-raw", "audio/x-raw"])
all_caps = st.lists(structures, max_size=3).map(Caps) | st.sampled_from([ANY, EMPTY])
fields_alike = structures_of(st.integers(0, 4) | int_ranges, ["video/x-raw"])
alike = st.lists(fields_alike, min_size=1, max_size=4).map(Caps)
sampled = settings(max_examples=80)


@given(all_caps)
@sampled
def test_written_caps_parse_to_equal_caps(caps: Caps) -> None:
    """With the same values and types."""
    again = Caps(str(caps))
    assert again.strictly_equal(caps)
    assert str(again) == str(caps)


@given(all_caps)
@sampled
def test_caps_are_a_subset_of_themselves(caps: Caps) -> None:
    """Caps also equal themselves and intersect with themselves."""
    same = Caps(caps)
    assert caps <= same
    assert caps == same
    assert caps.strictly_equal(same)
    assume(not any(map(allows_nothing, caps.structures)))
    assert caps & same == caps
    assert caps.intersect(same) == caps


def allows_nothing(structure: Structure) -> bool:
    """Whether there is an empty list among the fields."""
    return any(isinstance(value, ValueList) and not value.items for value in structure.fields.values())


@given(all_caps | alike, all_caps | alike)
@sampled
def test_intersection_is_commutative_and_within_both(a: Caps, b: Caps) -> None:
    """As sets a & b equals b & a, and is a subset of both."""
    both = a & b
    assert both == b & a
    assert both == a.intersect(b) == b.intersect(a)
    assert both <= a
    assert both <= b
    assert bool(both) is a.can_intersect(b)


@given(alike, alike, alike)
@sampled
def test_intersection_is_associative(a: Caps, b: Caps, c: Caps) -> None:
    """The order in which the pads of a chain negotiate does not matter."""
    assert (a & b) & c == a & (b & c)


@given(all_caps | alike, all_caps | alike)
@sampled
def test_union_contains_both(a: Caps, b: Caps) -> None:
    """And nothing else."""
    assert a <= a | b
    assert b <= a | b
    assert a | b == b | a
    if not (a.is_any or b.is_any):
        both = (*a.structures, *b.structures)
        assert all(any(one is known for known in both) for one in (a | b).structures)


@given(alike, alike, alike)
@sampled
def test_subset_is_transitive(a: Caps, b: Caps, c: Caps) -> None:
    """What lies within lies within everything around; intersections give such chains."""
    assert (a & b) & c <= a & b <= a
    assert (a & b) & c <= a
    if a <= b <= c:
        assert a <= c


@given(alike, st.lists(st.integers(0, 9), min_size=3, max_size=3))
@sampled
def test_other_forms_allow_the_same_formats(caps: Caps, numbers: list[int]) -> None:
    """A fixed format lies within caps where it lies within their normal form and their simple form."""
    fields: dict[str, Value] = dict(zip(("format", "width", "framerate"), numbers, strict=True))
    for features in ((), ("memory:A",)):
        one = Caps([Structure("video/x-raw", fields, features)])
        assert (one <= caps) is (one <= caps.normalize()) is (one <= caps.simplify())


@given(all_caps)
@sampled
def test_other_forms_of_any_caps(caps: Caps) -> None:
    """The normal form lies within the caps and stays as it is; neither form grows."""
    normal = caps.normalize()
    assert normal <= caps
    assert normal.normalize().strictly_equal(normal)
    assert len(caps.simplify().structures) <= len(caps.structures)


@given(all_caps, all_caps)
@sampled
def test_fixation_returns_an_allowed_format(caps: Caps, near: Caps) -> None:
    """Whatever the given value is."""
    if not caps.structures:
        assert caps.fixate(near) == caps
        return
    fixed = caps.fixate(near)
    assert fixed.is_fixed
    assert fixed <= caps
    assert fixed.fixate(near).strictly_equal(fixed)
    assert fixed & caps


@given(st.text(max_size=40) | st.text(alphabet='ab/,;=(){}[]<>"\\ 0129.-:', max_size=60), all_caps)
@sampled
def test_every_operation_returns_or_raises_a_caps_error(text: str, other: Caps) -> None:
    """For all caps that can be parsed."""
    try:
        caps = Caps(text)
        results = [caps & other, caps | other, caps.intersect(other), caps.fixate(other), caps.normalize()]
        results += [caps.simplify(), caps.truncate(), Caps(str(caps))]
    except (CapsSyntax, CapsTooLarge):
        results = []
    assert all(isinstance(str(found), str) for found in results)
