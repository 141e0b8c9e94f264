"""The environments for Gymnasium: one rig that drills a hole, and many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from drillenv.checks import InputError, shown
from drillenv.env.hole.task import HoleTask
from drillenv.env.scalar import DrillEnv
from drillenv.env.vector import DrillVectorEnv


class DrillBitEnv(DrillEnv):
    """A hole to be drilled at the least cost, with bits that wear and break and a shaker that gets hot.

    The rig is that of :class:`drillenv.env.scalar.DrillEnv`. A step runs its motion exactly for 0.25 s, which
    stands for 15 s of drilling: blows last milliseconds, wear and heat take minutes.

    ## Action space

    `Box(-1, 1, (4,), float32)`: frequency, amplitude and pressure as in :class:`drillenv.env.scalar.DrillEnv`, and

    | Num | Control | |
    |-----|---------|--|
    | 3 | change the bit | above 0: before the step, the bit is changed, which takes 5 minutes and a new bit |

    The pressure arrives within the step. The amplifier clips what it cannot give (0.52 V at 120 Hz, none below 98 Hz);
    `amplitude` in the observation is what it gave.

    ## Observation space

    `Box(20,)` float32: the 15 readings of :class:`drillenv.env.scalar.DrillEnv`, of the motion of the step, and

    | Num | Observation | Unit | Min | Max | Noise |
    |-----|-------------|------|-----|-----|-------|
    | 15 | coil_rise: rise of the coil over the air, by its thermometer | K | 0 | 200 | 1 |
    | 16 | hole_depth: depth of the hole | m | 0 | 100 | 0 |
    | 17 | depth_left: depth left to drill | m | 0 | 100 | 0 |
    | 18 | bit_depth: drilled with the present bit | m | 0 | 100 | 0 |
    | 19 | bit_blows: blows that the present bit has made | 1e6 | 0 | 10 | 0 |

    Hidden are the rock and its abrasivity, wear and strength of the bit, and the frequency at which the frame takes
    force from the drive.

    ## Reward

    In EUR: 600 for each metre drilled in the step, less what the step cost: rig and crew (180 an hour, drilling or
    standing), bits (80, the first with the first step) and energy. The sum over an episode is 600 times the depth less
    the cost, so that most reward is least cost per metre; `info["cost_per_metre"]` is the score. `costs=` takes other
    prices and durations, see :class:`drillenv.env.hole.costs.Costs`.

    ## What has to be weighed

    - A bit **wears** with every blow, more on abrasive layers, at high power, and above the rating of 2 kN; blows that
      do not come singly wear it up to five times as much. A **worn bit is blunt**: the contact is stiffer, progress
      slower, the best pressure another. It **breaks** when worn to its strength, which scatters: half an hour of
      fishing and a new bit. See :mod:`drillenv.env.hole.bit`.
    - The **coil heats** with the square of the force and with frequency; above a rise of 100 K the rig stands for five
      minutes. The **amplifier** clips. The **frame** takes up to 60 % of the force around a frequency between 85 and
      125 Hz that differs from rig to rig. See :mod:`drillenv.env.hole.shaker`.
    - **Layers** of 0.3 to 1.2 m, of the six cases of Table 2.2, with abrasivities that differ by up to ten.

    `without=["resonance"]` leaves terms out: wear, blunting, breakage, heat, amplifier, resonance, abrasivity, layers.

    ## Starting state

    A sharp bit over a hole that is not begun. The rig is set going at 85 Hz, 0.45 V and 0.6 bar, which gives the first
    readings and counts for nothing.

    ## Episode end

    Terminated when the depth is reached (4 m); in `drillenv/DrillBitShort-v0` (1 m) also when a bit breaks. Truncated
    after 600 steps (150 in the short variant).

    ## Info

    The truth, which a controller must not see: the names of :data:`drillenv.env.truth.TRUTH` but layer and depth, of
    the motion; those of :data:`drillenv.env.hole.readings.SHOWN`, of the hole (depths in m, time in s, money in EUR);
    `motion`; `cost`, the force above the rating in N; and `cost_per_metre` in EUR/m: what was spent so far over the
    depth of the hole, with 600 EUR for each metre that is not drilled.

    ## Arguments

    Args:
        depth: Of the holes that are drawn, in m.
        scenario: "train", "validation", "test", or a file of one's own: frozen holes.
        costs: A record of prices and durations, for instance {"bit": 120.0}.
        without: A list of terms to leave out.
        lost_bit_ends: Whether a bit that breaks ends the episode.
        actions: "absolute" or "increment"; the fourth is absolute always.
        noise: Factor on the noise of the sensors; 0 for none.
        errors: How many stated standard errors the constants of the rig are off by, drawn anew for each hole as in
            :class:`drillenv.env.scalar.DrillEnv`; none where left out. Not with a scenario.
        render_mode: None; these environments are not drawn yet.

    Raises:
        InputError: an argument is none of these, or two of them contradict each other.

    ## Version history

    - v0: first version.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": [], "render_fps": 4}

    def __init__(
        self,
        depth: float | None = None,
        scenario: str | None = None,
        costs: Mapping[str, float] | None = None,
        without: Sequence[str] = (),
        lost_bit_ends: bool = False,
        actions: str = "absolute",
        noise: float = 1.0,
        errors: float | None = None,
        render_mode: str | None = None,
    ):
        if render_mode is not None:
            raise InputError(f"render_mode is {shown(render_mode)}: DrillBit is not drawn, leave render_mode out")
        self._set_up(HoleTask(depth, scenario, costs, without, lost_bit_ends, actions, noise, errors), None)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Drill for 15 s, after a change of the bit where the action asks for it.

        Args:
            action: (4,) frequency, amplitude, pressure and change of the bit, each from -1 to 1.

        Returns:
            Observation, reward in EUR, whether the hole is done, False and the info.

        Raises:
            InputError: an action of another shape, not finite or outside [-1, 1]; the rig is left as it was.
            gymnasium.error.ResetNeeded: before the first reset, or after the end of the hole.
        """
        if self._started and self._batch.terminated[0]:
            raise gym.error.ResetNeeded("step was called after the end of the hole: call reset first")
        return super().step(action)


class DrillBitVectorEnv(DrillVectorEnv):
    """n rigs that each drill a hole; each is the environment :class:`DrillBitEnv`, to the last bit.

    Args:
        num_envs, max_episode_steps, autoreset_mode, threads, render_mode: As for
            :class:`drillenv.env.vector.DrillVectorEnv`.
        task: The arguments of DrillBitEnv: depth, scenario, costs, without, lost_bit_ends, actions, noise, errors.
    """

    def _task(self, arguments: dict[str, Any]) -> HoleTask:
        return HoleTask(**arguments)
