"""A slow, plain twin of the pixel: small cells of time, in each of which all is linear."""

import itertools

import numpy as np

CELL_NS = 1000.0


def walk_pixel(pixel, light, shots, tau, options):
    """Events (ns, polarity) of one pixel from time 0 on.

    pixel: dict of on, off, leak (per ns), moved, white. light: function of time, ns, and its end. shots: list of (ns,
    polarity, level). tau: function of time. options: dict of refractory (ns).
    """
    level, end = light
    v = level(0.0)
    reference, blind, events = v - pixel["moved"], 0.0, []
    stops = np.unique(np.concatenate([np.arange(0, end, CELL_NS), [s[0] for s in shots], [end]]))
    shots = list(shots)
    for begin, stop in itertools.pairwise(stops):
        middle = 0.5 * (begin + stop)
        constant = tau(middle)
        after = level(stop) if constant == 0 else v + (level(middle) - v) * -np.expm1(-(stop - begin) / constant)
        t, now = begin, v
        while t < stop:
            slope = (after - now) / (stop - t)
            if blind > t:
                t2 = min(blind, stop)
                now += slope * (t2 - t)
                t, reference = t2, now
                continue
            rate = slope + pixel["leak"]
            moved = now - reference
            bound = pixel["on"] if rate > 0 else -pixel["off"]
            wait = (bound - moved) / rate if rate else np.inf
            if wait <= stop - t:
                t += max(wait, 0.0)
                now += slope * max(wait, 0.0)
                events.append((t, int(rate > 0)))
                reference, blind = now, t + options["refractory"]
            else:
                reference -= pixel["leak"] * (stop - t)
                break
        v = after
        while shots and shots[0][0] <= stop:
            time, polarity, need = shots.pop(0)
            rate = 1 - 0.75 * min(np.exp(v - pixel["white"]), 1)
            if time >= blind and need < rate:
                events.append((time, polarity))
                reference, blind = v, time + options["refractory"]
    return events
