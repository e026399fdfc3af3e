"""A sensor's clock of few bits, continued over its wraps without following a single damaged value.

A value far from the latest trusted one counts for the events that follow it, but is trusted only when the next value
goes on from it. Where the next value goes on from the trusted one instead, it is as if the first had not been there:
a damaged word bends no time but that of its own events.
"""

from __future__ import annotations

from numba import njit

CURRENT, TRUSTED, KNOWN = range(3)
"""The clock's part of a state: the latest value and the latest trusted one, both with wraps; what is known of them."""

CLOCK_SIZE = 3
NOTHING, ONE_VALUE, CONFIRMED = range(3)

_FIRST_STEP = 4
"""How many times `limit` the second value of a stream may step forward over a wrap; else one of both is damaged."""


@njit(cache=True, nogil=True, inline="always")
def follow(value, period, back, limit, state, at):  # type: ignore[no-untyped-def]
    """Take the next value of a clock that counts modulo `period` into its part of `state`, which begins at `at`.

    back: largest step back that is no wrap. limit: largest step, either way, that needs no second value to be trusted.
    """
    trusted = state[at + TRUSTED]
    if state[at + KNOWN] == NOTHING:
        state[at + CURRENT] = state[at + TRUSTED] = trusted - trusted % period + value
        state[at + KNOWN] = ONE_VALUE
        return
    step = (value - trusted + back) % period - back
    if trusted + step < 0:  # no clock starts below zero
        step += period
    if state[at + KNOWN] == ONE_VALUE and (step < -limit or step > _FIRST_STEP * limit):
        step = value - trusted % period  # wraps cannot be told before two values agree
    if -limit <= step <= limit:
        state[at + CURRENT] = state[at + TRUSTED] = trusted + step
        state[at + KNOWN] = CONFIRMED
        return
    current = state[at + CURRENT]
    onward = (value - current + back) % period - back
    if current != trusted and -limit <= onward <= limit:
        state[at + CURRENT] = state[at + TRUSTED] = current + onward
        state[at + KNOWN] = CONFIRMED
        return
    if trusted < current <= trusted + step:  # still forward: a quiet stream, not a contradiction
        state[at + TRUSTED] = current
    state[at + CURRENT] = trusted + step
