"""What the numbers of a text say about its columns and its unit of time."""

from __future__ import annotations

from decimal import Decimal
from itertools import pairwise

from esfo_core.errors import RecordingError

Row = list[Decimal]

_POLARITIES = {Decimal(-1), Decimal(0), Decimal(1)}
_ORDERS = ("x,y,p,t", "t,x,y,p", "x,y,t,p", "t,p,x,y", "p,x,y,t", "t,y,x,p")
_MAX_PIXEL = 65535
_STEPS_BACK = 0.1  # share of the lines that may be out of order
_FEW = 20  # lines; in fewer, any column may happen not to decrease
_ENOUGH = 100  # lines to judge a rate by

_PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
_LATEST_S = 4_102_444_800  # the year 2100
_LOWEST_RATE, _HIGHEST_RATE = 10, 10**9  # events/s
_SLOW = 1000  # events/s; below, whole thousands are more likely ns of a clock of us than us of a clock of ms


def likely_columns(sample: list[Row], commas: bool) -> tuple[str, ...]:
    """Return the order of the columns of the rows: the time does not decrease, polarities and pixels are possible.

    Where several fit, the one that is usual between commas, or between spaces, counts.

    Raises RecordingError where none fits.
    """
    if not sample or len(sample[0]) != 4:
        found = len(sample[0]) if sample else 0
        raise RecordingError(f"text of {found} columns without names; say which they are by the option columns")
    rows = [row for row in sample if len(row) == 4]
    orders = [tuple(order.split(",")) for order in _ORDERS]
    if not commas:
        orders[:2] = orders[1], orders[0]
    for order in orders if len(rows) >= _FEW else orders[:2]:
        if _fits(rows, order):
            return order
    for order in orders[:2]:  # then the decoder tells which line is none
        if all(row[order.index("p")] in _POLARITIES for row in rows):
            return order
    raise RecordingError(
        "no order of columns fits: a time that does not decrease, and polarities 0 and 1, or -1 and 1; say the columns "
        "by the option columns"
    )


def _fits(rows: list[Row], order: tuple[str, ...]) -> bool:
    column = {name: [row[order.index(name)] for row in rows] for name in order}
    good = sum(
        p in _POLARITIES and t >= 0 and all(0 <= v <= _MAX_PIXEL and v == int(v) for v in pixel)
        for *pixel, p, t in zip(column["x"], column["y"], column["p"], column["t"], strict=True)
    )
    back = sum(after < before for before, after in pairwise(column["t"]))
    return good >= len(rows) * (1 - 1 / _ENOUGH) and back <= len(rows) * _STEPS_BACK


def likely_unit(times: list[Decimal]) -> str:
    """Return the unit that makes a plausible recording of the times: us for whole ones, s for others, unless it cannot.

    It cannot where the times come after the year 2100, or where there are fewer than ten events per second or more
    than a thousand per microsecond.

    Raises RecordingError where the unit stays open.
    """
    whole = all(t == int(t) for t in times)
    if whole and any(t.as_tuple().exponent != 0 for t in times):
        raise RecordingError("times with decimals that are all zero leave their unit open; say it by option time_unit")
    possible = [unit for unit in _PER_SECOND if not times or max(times) <= _LATEST_S * _PER_SECOND[unit]]
    units = [unit for unit in (("us", "ns", "ms") if whole else ("s", "ms", "us")) if unit in possible]
    if not units:
        raise RecordingError(f"a time of {max(times)} comes after the year 2100 in every unit")
    return next((unit for unit in units if _plausible(times, unit)), units[0])


def _plausible(times: list[Decimal], unit: str) -> bool:
    if len(times) < _ENOUGH:
        return True
    ordered = sorted(times)
    middle = ordered[len(times) // 20 : len(times) - len(times) // 20]  # single times may be wrong
    span = float(middle[-1] - middle[0]) / _PER_SECOND[unit]
    rate = len(middle) / span if span else _HIGHEST_RATE
    if unit == "us" and rate < _SLOW and not any(t % 1000 for t in times):
        return False
    return _LOWEST_RATE <= rate <= _HIGHEST_RATE
