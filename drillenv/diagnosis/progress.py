"""Where a diagnosis of the drilling rig is, how long it may yet take, and what it has found so far."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from typing import Any, NamedTuple

from drillenv.diagnosis.fitting import Fitted
from drillenv.diagnosis.score_tests import ScoreTests
from drillenv.diagnosis.steps import Step


class Stage(NamedTuple):
    """A part of a diagnosis."""

    number: int
    doing: str
    least: float
    """How long all from its beginning takes where nothing is missing, in times of the first stage, as was measured."""
    most: float
    """The same where two mechanisms are missing that no equation follows."""


STAGES = 5
FITTING = Stage(1, "fitting the paper's model", 0.0, 0.0)
SEARCHING = Stage(2, "looking for what is missing", 4.0, 45.0)
EXTENDING = Stage(3, "fitting whole recordings", 2.0, 9.0)
SEARCHING_AGAIN = Stage(4, "looking once more, on whole recordings", 1.0, 6.0)
PROVING = Stage(5, "proving it on recordings held out", 0.5, 3.0)
MARK = "stage "
"""What lines on stages begin with."""


class Known(NamedTuple):
    """What has been found so far."""

    plain: Fitted
    """The paper's model, on the same recordings or on stretches of them."""
    final: Fitted
    steps: list[Step]
    tested: ScoreTests


class OutOfTime(KeyboardInterrupt):
    """What a search may take is used up."""


class Progress:
    """Says where a diagnosis is, keeps what it has found, and ends the search where its time is up."""

    def __init__(
        self,
        say: Callable[[str], object],
        within: float = math.inf,
        clock: Callable[[], float] = time.monotonic,
        processor: Callable[[], float] = time.process_time,
    ) -> None:
        """Into ``say``; the search may take ``within`` s by the ``processor``, estimates are by the ``clock`` in s."""
        self.known: Known | None = None
        self.doing = ""
        self.stopped = ""
        """What was being done as it was interrupted."""
        self._say = say
        self._clock, self._processor = clock, processor
        self._first: float | None = None
        self._begun, self._last = clock(), processor() + within
        self._searching = False

    def say(self, text: str) -> None:
        """Tell what is being done.

        Raises:
            OutOfTime: the search has taken what it may, and something is known.
        """
        self._say(text)
        self.check_time()

    def check_time(self) -> None:
        """See that the search may go on.

        Raises:
            OutOfTime: it has taken what it may, and something is known.
        """
        if self._searching and self.known is not None and self._processor() > self._last:
            raise OutOfTime

    def stage(self, stage: Stage) -> None:
        """A stage begins."""
        if self._first is None and stage.number > FITTING.number:
            self._first = self._clock() - self._begun
        self.doing: str = stage.doing
        self._searching = stage is not PROVING
        estimate = ""
        if self._first is not None:
            estimate = f"; {span(stage.least * self._first, stage.most * self._first)} to go"
        self.say(f"{MARK}{stage.number} of {STAGES}: {stage.doing}{estimate}")

    def keep(self, plain: Fitted, final: Fitted, steps: list[Step], tested: ScoreTests) -> None:
        """What has been found so far."""
        self.known = Known(plain, final, steps, tested)


class Timed(Executor):
    """An executor whose calls fail once a search has taken what it may: fits end between evaluations of recordings."""

    def __init__(self, pool: Executor, progress: Progress) -> None:
        self._pool, self._progress = pool, progress

    def map(self, fn: Callable, *iterables: Any, **options: Any) -> Iterator:
        """See Executor.

        Raises:
            OutOfTime: by the iterator, where the time was up before a call.
        """

        def timed(*given: Any) -> Any:
            self._progress.check_time()
            return fn(*given)

        return self._pool.map(timed, *iterables, **options)


def span(least: float, most: float) -> str:
    """A time in words, from s."""
    if most < 60.0:
        return f"about {max(least, 1.0):.0f} to {max(most, 2.0):.0f} s"
    low, high = (float(f"{each / 60.0:.1g}") for each in (max(least, 6.0), most))
    return f"about {low:g} to {high:g} min"
