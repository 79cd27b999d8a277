"""Frame rates in caps, as videorate converts them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import Any

from streamkit.flow.caps import Caps, Structure
from streamkit.flow.caps_values import FractionRange, ValueList
from streamkit.flow.video import NTSC

VARIABLE = Fraction(0)
MAX_RATE = Fraction(2**31 - 1)
ANY_RATE = FractionRange(VARIABLE, MAX_RATE)


def rates_after(caps: Caps, max_rate: int, *, drop_only: bool) -> Caps:
    """Output caps for input caps: the same rate first, then any other."""

    def options(structure: Structure) -> Iterable[Structure]:
        rate = structure.fields.get("framerate")
        highest = Fraction(max_rate)
        if rate is not None:
            yield from _limited(structure, rate, highest)
        top = highest
        if drop_only and rate is not None and rate_bounds(rate)[1] > 0:
            top = min(highest, rate_bounds(rate)[1])
        yield structure.with_field("framerate", FractionRange(VARIABLE, top))

    return _each(caps, options)


def rates_before(caps: Caps, max_rate: int, *, drop_only: bool) -> Caps:
    """Input caps for output caps: rates that can become the output's, the cheapest first.

    First the same rate, then any other; with `drop_only` only rates at least as high, or variable ones.
    """

    def options(structure: Structure) -> Iterable[Structure]:
        rate = structure.fields.get("framerate")
        if not drop_only:
            yield structure
            if rate is not None:
                yield structure.with_field("framerate", ANY_RATE)
            return
        yield from _limited(structure, rate if rate is not None else ANY_RATE, Fraction(max_rate))
        if rate is None:
            yield structure.with_field("framerate", ANY_RATE)
            return
        yield structure
        low = rate_bounds(rate)[0]
        yield structure.with_field("framerate", FractionRange(low, MAX_RATE))
        if low > 0:
            yield structure.with_field("framerate", VARIABLE)

    return _each(caps, options)


def _each(caps: Caps, options: Callable[[Structure], Iterable[Structure]]) -> Caps:
    """The options of each structure, without repetition."""
    unique = {str(found): found for structure in caps.structures for found in options(structure)}
    return Caps(list(unique.values()))


def _limited(structure: Structure, rate: Any, highest: Fraction) -> Iterable[Structure]:
    """The structure with the rates up to the highest, if any."""
    allowed = Caps([structure.with_field("framerate", rate)]) & Caps(
        [structure.with_field("framerate", FractionRange(VARIABLE, highest))]
    )
    return allowed.structures


def rate_bounds(rate: Any) -> tuple[Fraction, Fraction]:
    """Minimum and maximum of a rate, a range or a list."""
    if isinstance(rate, FractionRange):
        return rate.low, rate.high
    if isinstance(rate, ValueList):
        bounds = [rate_bounds(item) for item in rate.items]
        return min(low for low, _ in bounds), max(high for _, high in bounds)
    return Fraction(rate), Fraction(rate)


def estimated_rate(interval_ns: int) -> Fraction:
    """The standard frame rate of an interval: an integer, or an integer times 1000/1001."""
    exact = Fraction(1_000_000_000, interval_ns)
    for standard in (Fraction(round(exact)), round(exact / NTSC) * NTSC):
        if standard > 0 and abs(standard - exact) * 2000 < exact:
            return standard
    return exact.limit_denominator(1001)
