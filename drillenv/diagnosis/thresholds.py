"""The numbers that decide what a diagnosis says, each with its reason; all else is effort, physics or statistics.

Those without a reason of statistics were set on the sixty campaigns of the concealed rig with seed 4242, of which no
count is published.
"""

from __future__ import annotations

FALSE_ALARMS = 0.002
"""Probability that a campaign where nothing is missing gives any family a gain that counts."""
ALIKE = 0.01
"""Probability of calling an equation worse than the free law though it is the true one."""
SEVERAL = 3.5
"""Stated standard deviations from which a constant is wrong: labs misjudge theirs by a half."""
LEFT = 0.06
"""Over-dispersion, as a share of the noise's power up to 6 kHz, to which recordings are thinned, up to which nothing is
left to explain."""
NOISE_KNOWN = 0.02
"""Relative error of the noise's power: it is estimated from the same residuals, to one or two hundredths."""
LAW_ERROR = 0.05
"""Relative error up to which an equation is said to give a fitted law: it leaves a share LAW_ERROR^2 of its gain. The
trial's rules ask for laws within a tenth."""
LAW_LEFT = 0.1
"""Relative error of a law that was found, as coarse as it is fitted: what that leaves, a share LAW_LEFT^2 of its gain,
calls for nothing further. In a model that is far off also the share of all that is left by which an equation may be
worse than a free law, and a family than one of more parameters, which take up a part of what else is missing."""
UNCONFIRMED = 0.03
"""Share of a gain that may be lost on recordings that are left out: what is there gains on them, but for chance."""
NEAR = 0.25
"""Share of the best score test's gain from which a family is a candidate: the score test is quadratic about a model
that lacks the law, and families that fit best are not always first by it."""
FAINT = 0.05
"""The same for families with states of their own, whose gain at zero strength says little."""
POSSIBLE = 0.1
"""p-value on stretches up to which a family is tested on whole recordings: with several times the samples, one that is
there is much less likely by chance than this already."""
MATERIAL = LAW_LEFT**2
"""Share of the mismatch that a mechanism has to explain beside the others to be named: errors of their laws leave as
much."""
SURELY = 0.1
"""The same from which it need not be seen to gain in recording after recording."""
RESOLVED = 5e-4
"""Of what the channels read, root mean square: what changes them by less is not told from errors of the sensors, whose
linearity is 0.05 % at best. Noise that is not quite as it is estimated gains as much in long recordings."""
SKEW = 2e-6
"""Seconds by which channels of a logger may be apart: their filters delay by some 1e-4 s, to a hundredth or two."""
TINY = 2e-3
"""Of the force, root mean square: what explains less is no physics that anybody misses."""
SLIGHT = 0.01
"""Of the force: what is left below that is not a mismatch that anybody asks about."""
AGAIN = 0.01
"""p-value of a one-sided t test over recordings by which a mechanism gains on recordings that are left out."""
WELL_EXPLAINED = 0.8
"""Share of the mismatch, of recordings left out, from which what was found accounts for it."""
CLOSE = 2.0
"""Reduced chi-square up to which a model is close: from there on its windows are joined, and residuals show the
noise. Thinned recordings leave out of it half the noise or more, and none of the misfit."""
AMPLITUDE_OFF = 0.03
"""Relative error of a stated amplitude from which it is wrong: labs read theirs to one per cent."""
PRESSURE_SCATTER = 0.01
"""Relative standard deviation of a stated pressure, at least: so well regulators are read, and offsets of load cells
scatter."""
STANDS_OUT = 6.0
"""Standard deviations off the others from which a pressure is another one."""
MOST_WRONG = 4
"""At most one label in so many recordings is corrected; where more are off, it is not the labels."""
AT_REST_FORCE = 0.05
"""Share of a usual peak that the force of an indenter at rest against the rock has not reached at the first sample."""
AT_REST_SPEED = 0.12
"""m/s at the first peak of the force that errors of the sensors leave of the speed of a rig that was at rest."""
MOST_OF_LAW = 0.5
"""Share of a law's gain that an equation may lack and still be said to explain most of it."""
SHARP = 0.5
"""Share of what a law leaves that may be left with corners in it for them to be its own, while more may be missing."""
TENSE = 2.0
"""Stated standard deviations from which a constant may be held back from where an equation would have it."""
EQUAL = 5.0
"""Log-likelihood by which two families must differ to be told apart."""
SILENT = 0.7
"""Share of a constant's stated standard deviation that is left of it where the recordings say nothing."""
YIELDING = 0.5
"""Share of a spring's tangent stiffness that is left where it is deflected most, below which its force saturates."""
STRAIGHT_END = 0.05
"""Change of a contact's stiffness from the last sixth but one of its force to the last, up to which it is straight."""
NOT_LEVEL = 0.08
"""Change of a gain from which a response is not level: a tenth, less what a free response is off."""
STRUCK, STRUCK_DRILL = 1.3, 1.1
"""Mean square over the noise from which a recording is said to differ from the model, of a single body and of the
drill, whose residuals are many more."""
REPORTED_LINE = 0.2
"""Share of what is left that a line must have to be spoken of."""
NOISY = 0.5
"""Noise over signal from which there is nothing to diagnose."""
MOST_FAMILIES = 4
"""Families, at most."""
