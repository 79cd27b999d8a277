"""Frame rates in caps: what videorate can make of them."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import Any

from streamkit.flow.caps import Caps, Structure
from streamkit.flow.caps_values import FractionRange, ValueList

VARIABLE = Fraction(0)
MOST = Fraction(2**31 - 1)
ANY_RATE = FractionRange(VARIABLE, MOST)
NTSC = Fraction(1000, 1001)


def rates_after(caps: Caps, max_rate: int, *, drop_only: bool) -> Caps:
    """What can come out for frames with these caps: the same rate first, then any other that is allowed."""

    def ways(structure: Structure) -> Iterable[Structure]:
        rate = structure.fields.get("framerate")
        highest = Fraction(max_rate)
        if rate is not None:
            yield from _limited(structure, rate, highest)
        top = highest
        if drop_only and rate is not None and highest_rate(rate) > 0:
            top = min(highest, highest_rate(rate))
        yield _with_rate(structure, FractionRange(VARIABLE, top))

    return _each(caps, ways)


def rates_before(caps: Caps, max_rate: int, *, drop_only: bool) -> Caps:
    """What can come in where these caps are to come out."""

    def ways(structure: Structure) -> Iterable[Structure]:
        rate = structure.fields.get("framerate")
        if not drop_only:
            yield structure
            if rate is not None:
                yield _with_rate(structure, ANY_RATE)
            return
        yield from _limited(structure, rate if rate is not None else ANY_RATE, Fraction(max_rate))
        if rate is None:
            yield _with_rate(structure, ANY_RATE)
            return
        yield structure
        low = lowest_rate(rate)
        yield _with_rate(structure, FractionRange(low, MOST))
        if low > 0:
            yield _with_rate(structure, VARIABLE)

    return _each(caps, ways)


def _each(caps: Caps, ways: Any) -> Caps:
    found = {str(way): way for structure in caps.structures for way in ways(structure)}
    return Caps(list(found.values()))


def _limited(structure: Structure, rate: Any, highest: Fraction) -> Iterable[Structure]:
    """The structure with the rates that are not above the highest, if there are any."""
    allowed = Caps([_with_rate(structure, rate)]) & Caps(
        [_with_rate(structure, FractionRange(VARIABLE, highest))]
    )
    return allowed.structures


def _with_rate(structure: Structure, rate: Any) -> Structure:
    return Structure(structure.name, {**structure.fields, "framerate": rate}, structure.features)


def highest_rate(rate: Any) -> Fraction:
    """The highest of a rate, a range or a list."""
    if isinstance(rate, FractionRange):
        return rate.high
    if isinstance(rate, ValueList):
        return max(highest_rate(item) for item in rate.items)
    return Fraction(rate)


def lowest_rate(rate: Any) -> Fraction:
    """The lowest of a rate, a range or a list."""
    if isinstance(rate, FractionRange):
        return rate.low
    if isinstance(rate, ValueList):
        return min(lowest_rate(item) for item in rate.items)
    return Fraction(rate)


def guessed_rate(interval_ns: int) -> Fraction:
    """The usual frame rate that an interval stands for: a whole number, or that times 1000/1001."""
    exact = Fraction(1_000_000_000, interval_ns)
    for usual in (Fraction(round(exact)), round(exact / NTSC) * NTSC):
        if usual > 0 and abs(usual - exact) * 2000 < exact:
            return usual
    return exact.limit_denominator(1001)
