"""When a quantity of the rig next reaches a place where a force has a corner, as far as the accelerations tell."""

import math

from numba.extending import register_jitable


@register_jitable
def time_to(off, speed, change):
    """Seconds until ``off + speed t + change t^2 / 2`` is 0, where that lies ahead; infinity where it does not."""
    square = speed * speed - 2.0 * change * off
    if square < 0.0:
        return math.inf
    first = math.inf
    # both roots from a sum of speeds, neither from a difference of near equals
    both = speed + math.copysign(math.sqrt(square), speed)
    if both != 0.0 and off / both < 0.0:
        first = -2.0 * off / both
    if change != 0.0 and both / change < 0.0:
        first = min(first, -both / change)
    return first
