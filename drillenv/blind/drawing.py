"""Small figures as SVG, written by hand: axes, lines and bars for the page of a trial."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

Floats = NDArray[np.float64]

POINTS_OF_A_LINE = 600
"""At most: two for each column of pixels, so that no peak is lost."""


def tag(name: str, *inside: Any, **attributes: Any) -> Markup:
    """An element of SVG, its text and attributes escaped."""
    written = Markup("").join(
        Markup(' {}="{}"').format(key.rstrip("_").replace("_", "-"), value) for key, value in attributes.items()
    )
    return Markup("<{0}{1}>{2}</{0}>").format(Markup(name), written, Markup("").join(escape(each) for each in inside))


def text(x: float, y: float, text: str, anchor: str = "middle", **more: Any) -> Markup:
    """A text at a place."""
    return tag("text", text, x=f"{x:.1f}", y=f"{y:.1f}", text_anchor=anchor, **more)


def line(x1: float, y1: float, x2: float, y2: float, kind: str) -> Markup:
    """A straight line of a class of trial.css."""
    return tag("line", x1=f"{x1:.1f}", y1=f"{y1:.1f}", x2=f"{x2:.1f}", y2=f"{y2:.1f}", class_=kind)


def bar(share: Mapping[str, Any]) -> Markup:
    """A share as a bar from 0 to 100 %, with whiskers over its interval."""
    width, height = 120.0, 14.0
    at, low, high = (width * each for each in (share["hits"] / share["of"], share["low"], share["high"]))
    middle = height / 2.0
    label = share_text(share)
    return tag(
        "svg",
        tag("rect", x=0, y=1, width=width, height=height - 2, class_="ground"),
        tag("rect", x=0, y=3, width=f"{at:.1f}", height=height - 6, class_="share"),
        line(low, middle, high, middle, "whisker"),
        line(low, 4, low, height - 4, "whisker"),
        line(high, 4, high, height - 4, "whisker"),
        viewBox=f"-1 0 {width + 2:g} {height:g}",
        width=width + 2,
        height=height,
        class_="bar",
        role="img",
        aria_label=label,
    )


def share_text(share: Mapping[str, Any]) -> str:
    """A share and its interval in words."""
    percent = [f"{100.0 * each:.0f}" for each in (share["hits"] / share["of"], share["low"], share["high"])]
    return f"{percent[0]} %, 95 % interval {percent[1]} to {percent[2]} %"


@dataclass(frozen=True, slots=True)
class Axis:
    """A straight or logarithmic axis, ``low`` at 0 and ``high`` at ``length`` pixels."""

    low: float
    high: float
    length: float
    label: str
    logarithmic: bool = False
    downwards: bool = False
    """Of a vertical axis, whose pixels count from its top."""

    def at(self, value: Any) -> Any:
        """Pixels."""
        low, high = (math.log(each) if self.logarithmic else each for each in (self.low, self.high))
        share = (np.log(value) if self.logarithmic else np.asarray(value, dtype=float)) - low
        share = share / (high - low)
        return self.length * (1.0 - share if self.downwards else share)

    def ticks(self) -> list[float]:
        """Round values within the axis: a handful, of a logarithmic one 1, 2 and 5 of each decade."""
        if self.logarithmic:
            decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
            steps = (1, 2, 5) if self.high / self.low < 300.0 else (1,)
            every = [step * 10.0**each for each in decades for step in steps]
            return [each for each in every if self.low <= each <= self.high]
        rough = (self.high - self.low) / (4.0 if self.length < 200.0 else 6.0)
        size = 10.0 ** math.floor(math.log10(rough))
        step = size * next(each for each in (1.0, 2.0, 5.0, 10.0) if each * size >= rough)
        first = math.ceil(self.low / step)
        return [i * step for i in range(first, math.floor(self.high / step) + 1)]


def chart(x: Axis, y: Axis, inside: Sequence[Markup], label: str, over: Sequence[Markup] = ()) -> Markup:
    """Axes with ticks and labels around what is drawn inside, which is cut off at the frame."""
    left, top, right, bottom = 54.0, 8.0, 14.0, 38.0
    parts = []
    for value in y.ticks():
        at = float(y.at(value))
        parts += [line(0, at, x.length, at, "grid"), text(-5, at + 3.5, tick(value), "end")]
    for value in x.ticks():
        at = float(x.at(value))
        parts += [line(at, 0, at, y.length, "grid"), text(at, y.length + 14, tick(value))]
    parts += [
        # a nested svg cuts off what lies outside of it
        tag("svg", *inside, x=0, y=0, width=x.length, height=y.length),
        tag("rect", x=0, y=0, width=x.length, height=y.length, class_="frame"),
        text(x.length / 2.0, y.length + 30, x.label),
        text(0, 0, y.label, transform=f"translate(-43 {y.length / 2.0:.1f}) rotate(-90)"),
        *over,
    ]
    width, height = left + x.length + right, top + y.length + bottom
    return tag(
        "svg",
        tag("g", *parts, transform=f"translate({left:g} {top:g})"),
        viewBox=f"0 0 {width:g} {height:g}",
        class_="chart",
        role="img",
        aria_label=label,
    )


def tick(value: float) -> str:
    """A number beside an axis."""
    return "0" if abs(value) < 1e-12 else f"{value:.4g}".replace("-", "\u2212")


def path(x: Axis, y: Axis, at: Floats, values: Floats, kind: str) -> Markup:
    """A line; NaN leaves a gap."""
    words, gap = [], True
    for left, top in zip(x.at(at), y.at(values), strict=True):
        if not (math.isfinite(left) and math.isfinite(top)):
            gap = True
            continue
        # far outside of the frame a coordinate says no more than that
        words.append(f"{'M' if gap else 'L'}{left:.1f} {min(max(top, -999.0), 9999.0):.1f}")
        gap = False
    return tag("path", d="".join(words), class_=kind)


def thinned(time: Floats, values: Floats) -> tuple[Floats, Floats]:
    """At most ``POINTS_OF_A_LINE`` samples: the least and the largest of each of so many stretches."""
    if values.size <= POINTS_OF_A_LINE:
        return time, values
    known = np.nan_to_num(values)
    kept: set[int] = set()
    for part in np.array_split(np.arange(values.size), POINTS_OF_A_LINE // 2):
        kept |= {int(part[np.argmin(known[part])]), int(part[np.argmax(known[part])])}
    chosen = np.array(sorted(kept))
    return time[chosen], values[chosen]


def limits(*series: Floats, room: float = 0.06) -> tuple[float, float]:
    """The range of finite values, with some room; never empty."""
    joined = np.concatenate(series)
    joined = joined[np.isfinite(joined)]
    low, high = (float(joined.min()), float(joined.max())) if joined.size else (0.0, 1.0)
    width = high - low if high > low else max(abs(high), 1e-9)
    return low - room * width, high + room * width
