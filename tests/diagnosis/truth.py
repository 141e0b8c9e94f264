"""A made campaign's truth, in the package's own words."""

from drillenv.blind.campaigns import Made
from drillenv.blind.mechanisms import MECHANISMS, Concealed, of_library
from drillenv.dynamics.effects import Chosen
from drillenv.recordings import Recording
from drillenv.rig import TOLERANCES, Rig
from drillenv.rocks import Rock


def rig_of(made: Made) -> Rig:
    """The rig that was recorded."""
    return Rig(**{name: made.true._asdict()[name] for name in TOLERANCES})


def rock_of(made: Made) -> Rock:
    """The rock that was recorded."""
    true = made.true._asdict()
    return Rock(true["loading_stiffness"], true["unloading_stiffness"])


def by_frequency(made: Made) -> list[Recording]:
    """Its recordings, the slowest excitation first."""
    return sorted(made.campaign.recordings, key=lambda each: each.setting.frequency if each.setting else 0.0)


def concealed_as(*effects: Chosen) -> tuple[Concealed, ...]:
    """The catalogue's mechanisms with the numbers of these effects of the library."""
    made = []
    for each in effects:
        stated = {part.symbol: value for part, value in zip(each.effect.parameters, each.values, strict=True)}
        made.append(of_library(each.effect.name, MECHANISMS, **stated))
    return tuple(made)
