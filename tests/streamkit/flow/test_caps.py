"""Caps: construction, comparison, union, fixation and errors."""

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit import ANY, Caps, Structure
from streamkit.errors import CapsTooLarge
from streamkit.flow.caps import EMPTY

RAW = "video/x-raw, format={ GRAY8, BGR }, width=[ 1, 4096 ]"
names = st.sampled_from(["a/b", "a/c", "a/b, f=1", "a/b, f={ 1, 2 }", "a/b(memory:A)"])
all_caps = st.lists(names, max_size=3).map("; ".join).map(lambda text: Caps(text or "EMPTY"))
sampled = settings(max_examples=60)


@given(all_caps)
@sampled
def test_equal_caps_have_equal_hashes(caps: Caps) -> None:
    """Also if written in another order."""
    turned = caps if caps.is_any else Caps(tuple(reversed(caps.structures)))
    assert turned == caps
    assert hash(turned) == hash(caps)


def test_any_and_empty() -> None:
    """ANY intersects everything, EMPTY nothing; neither is fixed."""
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
    """An intersection keeps the order of its left side."""
    wanted = Caps("video/x-raw, format={ NV12, GRAY8 }; video/x-h264")
    offered = Caps("video/x-h264; video/x-raw, format={ GRAY8, NV12 }")
    assert str(wanted & offered) == "video/x-raw, format=(string){ NV12, GRAY8 }; video/x-h264"


def test_a_missing_field_means_any_value() -> None:
    """Caps without a field are a superset."""
    assert Caps("video/x-raw, width=320") <= Caps("video/x-raw")
    assert not Caps("video/x-raw") <= Caps("video/x-raw, width=320")


def test_different_features_do_not_intersect() -> None:
    """`ANY` intersects all features."""
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


def test_with_and_without_fields() -> None:
    """Both return new caps."""
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


def test_fixation_is_near_the_given_caps() -> None:
    """Each field gets the given value or the nearest allowed one."""
    allowed = Caps("video/x-raw, format={ BGR, GRAY8 }, width=[ 16, 256 ], height=[ 16, 256 ]")
    near = Caps("video/x-raw, format=GRAY8, width=640, height=64")
    assert str(allowed.fixate(near)) == "video/x-raw, format=(string)GRAY8, width=(int)256, height=(int)64"


def test_caps_compare_with_caps_only() -> None:
    """A string is not equal to caps."""
    assert Caps("a/b") != "a/b"
    assert repr(Caps("a/b")) == "Caps('a/b')"
    assert Caps(Caps("a/b")) == Caps("a/b")


def test_structures_are_equal_whatever_the_order_of_their_fields() -> None:
    """Fields are a set; a type that differs makes another structure."""
    one = Structure("a/b", {"x": 1, "y": 2})
    assert one == Structure("a/b", {"y": 2, "x": 1})
    assert one != Structure("a/b", {"x": 1.0, "y": 2})


@pytest.mark.parametrize(
    ("one", "other", "zigzag", "first"),
    [
        ("f/A; f/B; f/C; f/D", "f/D; f/A; f/B; f/C", "f/A; f/D; f/B; f/C", "f/A; f/B; f/C; f/D"),
        ("f/D; f/A", "f/A; f/D", "f/A; f/D", "f/D; f/A"),
        ("f/A", "f/A, x=1; f/A, x=2", "f/A, x=(int)1; f/A, x=(int)2", "f/A, x=(int)1; f/A, x=(int)2"),
        ("f/A", "ANY", "f/A", "f/A"),
        ("ANY", "EMPTY", "EMPTY", "EMPTY"),
    ],
)  # fmt: skip
def test_both_orders_of_an_intersection(one: str, other: str, zigzag: str, first: str) -> None:
    """`&` keeps the order of the left side; `intersect` weighs both as gst_caps_intersect does."""
    assert str(Caps(one).intersect(Caps(other))) == zigzag
    assert str(Caps(one) & Caps(other)) == first


def test_union_leaves_out_what_is_there() -> None:
    """The second is appended where the first does not contain it; a wider one does not replace a narrower."""
    assert str(Caps("a/b, f=[ 1, 2 ]") | Caps("a/b, f=1")) == "a/b, f=(int)[ 1, 2 ]"
    assert str(Caps("a/b, f=1") | Caps("a/b")) == "a/b, f=(int)1; a/b"
    assert str(Caps("a/b(memory:A)") | Caps("a/b(ANY)")) == "a/b(memory:A); a/b(ANY)"


def test_strict_equality_sees_the_order() -> None:
    """Equal caps allow the same; strictly equal ones prefer the same too."""
    one, other = Caps("a/b; c/d"), Caps("c/d; a/b")
    assert one == other
    assert not one.strictly_equal(other)
    assert one.strictly_equal(Caps("a/b; c/d"))
    assert not one.strictly_equal(ANY)


def test_truncation_keeps_the_first() -> None:
    """Only the preferred structure is left."""
    assert str(Caps("a/b; c/d").truncate()) == "a/b"
    assert ANY.truncate() is ANY


def test_too_many_structures_are_refused() -> None:
    """An intersection with too many structures is an error."""
    one = Caps("; ".join(f"a/b, f={index}" for index in range(40)))
    other = Caps("; ".join(f"a/b, g={index}" for index in range(40)))
    with pytest.raises(CapsTooLarge, match=r"^the caps would have more than 512 structures$"):
        one & other


def test_parsed_texts_are_cached() -> None:
    """Caps of equal text share immutable structures."""
    assert Caps("x/y, z=1").structures is Caps("x/y, z=1").structures


def test_fields_are_changed_in_every_structure() -> None:
    """By a function of the fields; media types, features and their order stay. Of equal ones one is left."""
    caps = Caps("a/b(memory:A), width=2, rate=1; a/c, rate=5; a/b(memory:A), width=2, rate=3")
    halved = caps.map_fields(lambda fields: {name: 2 if name == "rate" else fields[name] for name in fields})
    assert str(halved) == (
        "a/b(memory:A), width=(int)2, rate=(int)2; a/c, rate=(int)2; a/b(memory:A), width=(int)2, rate=(int)2"
    )
    assert str(caps.without_fields("rate")) == "a/b(memory:A), width=(int)2; a/c"
