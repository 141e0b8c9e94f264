"""The command line: reads the options, calls the package, prints."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import math
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import drillenv
from drillenv.checks import InputError, choice, count, number, shown
from drillenv.cli_campaign import add_campaign
from drillenv.cli_controllers import add_export, add_film, add_league, add_record, add_train
from drillenv.cli_options import Parser, add_commands, add_json, plain_number, print_json, whole_number
from drillenv.completion import PrintCompletion
from drillenv.corrected import effect_record, read_model
from drillenv.files import check_writable, made_folder
from drillenv.rig import (
    AMPLITUDE_LIMITS,
    AMPLITUDE_RANGE,
    FREQUENCY_LIMITS,
    FREQUENCY_RANGE,
    PRESSURE_LIMITS,
    PRESSURE_RANGE,
    Rig,
    Setting,
)
from drillenv.rocks import ROCKS, STIFFNESS_LIMITS, Rock, rock

if TYPE_CHECKING:
    from drillenv.atlas import Sweep
    from drillenv.dynamics.effects import Chosen
    from drillenv.dynamics.motion import Motion
    from drillenv.dynamics.simulate import Run

BAD_INPUT, INTERRUPTED, BROKEN_PIPE = 2, 130, 141
"""Exit codes; the last two are those that a shell gives to a command ended by SIGINT or SIGPIPE."""

CONTROLS = {
    "frequency": ("HZ", "excitation frequency in Hz", FREQUENCY_LIMITS, FREQUENCY_RANGE),
    "amplitude": ("V", "excitation voltage amplitude in V", AMPLITUDE_LIMITS, AMPLITUDE_RANGE),
    "pressure": ("BAR", "pneumatic pressure in bar", PRESSURE_LIMITS, PRESSURE_RANGE),
}
SWEPT = {"frequency": "Hz", "amplitude": "V", "pressure": "bar", "stiffness": "N/m"}
RIG_UNITS = {
    "shaker_mass": "m1 in kg",
    "indenter_mass": "m2 in kg",
    "stiffness": "k of the structure in N/m",
    "damping": "c of the structure in N s/m",
    "drive_gain": "factor on Eq. 3.5",
    "pressure_gain": "factor on Eq. 3.6",
}
_DRIVE = "--amplitude 0.45 --pressure 1.0"
_PLACE = f"--rock 4 --frequency 120 {_DRIVE}"
COMMANDS = {
    "simulate": ("run the rig and write what its sensors see", f"{_PLACE} --seconds 2 --out run.csv"),
    "motion": ("the motion that the rig settles on", _PLACE),
    "sweep": (
        "the motions along a control or the rock's stiffness: a bifurcation diagram",
        f"--rock 4 --over frequency --from 50 --to 120 --step 0.1 {_DRIVE} --out sweep.png",
    ),
    "atlas": (
        "where one impact a period exists, over frequency, amplitude and pressure",
        "--rock 4 --points 15 7 7 --out atlas.nc --plot atlas.png",
    ),
    "campaign": ("write, check and look at the description of recordings", "check CAMPAIGN"),
    "indentation": (
        "fit a quasi-static indentation test: the stiffnesses of a rock",
        "CURVE.csv --compliance 5e-9 --out rock.json",
    ),
    "diagnose": ("where recordings and simulation differ, and by which physics", "CAMPAIGN --out diagnosis"),
    "compare": (
        "what differs between two diagnoses, as before and after a repair",
        "before/report.json after/report.json",
    ),
    "prove": (
        "conceal physics in made campaigns, have them diagnosed blindly, and mark the answers",
        "--out trial --seed 7 --campaigns 4",
    ),
    "league": (
        "controllers through the same episodes: what each is worth, and how surely",
        "--controllers rules seeking --scenario validation --episodes 8 --json league.json",
    ),
    "train": ("train a policy, so that it can be stopped at any moment and go on", "--algo ppo --out runs/ppo-0"),
    "export": (
        "a policy that runs with numpy alone, from a run of training or a saved model",
        "--run runs/ppo-0 --out policies/ppo-0",
    ),
    "record": (
        "play of controllers as a dataset of Minari, for offline learning",
        "--controllers rules --dataset drillenv/rules-v0 --episodes 8",
    ),
    "film": (
        "an episode as a film: one controller or several beside each other",
        "--controllers rules shipped --out change.gif",
    ),
    "paper": ("compute every published motion and draw its figure", "--out paper"),
    "demo": ("what all of this does: a page that leads to motions, a film and a diagnosis", "--out demo"),
}
"""What each command does, and the options of an example."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        The exit code: 0, 1 where a check found something, 2 on bad input, 130 if interrupted, 141 on a closed pipe.
    """
    try:
        given = _parser().parse_args(arguments)
        if given.compiles:
            _announce_compilation()
        code = given.run(given) or 0
        sys.stdout.flush()
    except InputError as error:
        return _say(str(error), BAD_INPUT)
    except KeyboardInterrupt as stopped:
        return _say(str(stopped) or "interrupted", INTERRUPTED)
    except BrokenPipeError:
        _drop_output()
        return BROKEN_PIPE
    except OSError as error:
        _drop_output()
        where = f" {shown(str(error.filename))}" if error.filename else ""
        return _say(f"cannot write{where}: {error.strerror or error}", BAD_INPUT)
    except SystemExit as end:  # --help and --version
        return end.code if isinstance(end.code, int) else 0
    return code


def _announce_compilation() -> None:
    from drillenv.compiling import announce  # imports Numba, which --help has no need of

    announce()


def _say(message: str, code: int) -> int:
    """One line on stderr, and the exit code."""
    print(f"drillenv: {' '.join(message.split())}", file=sys.stderr)
    return code


def _drop_output() -> None:
    """Send what is left to print nowhere, or Python would complain about it on its way out."""
    with contextlib.suppress(OSError, ValueError):  # where it is no real file, as under a test
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


# --- The options


def _parser() -> Parser:
    """The parser of all commands."""
    parser = Parser(prog="drillenv", description="A percussive-drilling rig, simulated exactly.", allow_abbrev=False)
    parser.set_defaults(compiles=True)
    parser.add_argument("--version", action="version", version=f"drillenv {drillenv.__version__}")
    parser.add_argument("--print-completion", action=PrintCompletion, help="print a script that completes commands")
    add_commands(parser, "command", _commands())
    return parser


def _commands() -> Iterable[tuple[str, Callable[[Parser], None], str, str]]:
    """All commands: the name of each, what adds its options, what it does, and an example's options."""
    adders = {
        "simulate": _add_simulate,
        "motion": _add_motion,
        "sweep": _add_sweep,
        "atlas": _add_atlas,
        "campaign": add_campaign,
        "indentation": _add_indentation,
        "diagnose": _add_diagnose,
        "compare": _add_compare,
        "prove": _add_prove,
        "league": add_league,
        "train": add_train,
        "export": add_export,
        "record": add_record,
        "film": add_film,
        "paper": _add_paper,
        "demo": _add_demo,
    }
    return ((name, adders[name], *told) for name, told in COMMANDS.items())


def _add_controls(parser: Parser, required: bool = True) -> None:
    group = parser.add_argument_group("setting")
    for name, (metavar, meaning, limits, box) in CONTROLS.items():
        note = f"{meaning}, {limits[0]:g} to {limits[1]:g} (the paper explores {box[0]:g} to {box[1]:g})"
        group.add_argument(f"--{name}", type=plain_number, required=required, metavar=metavar, help=note)


def _add_rock(parser: Parser) -> None:
    group = parser.add_argument_group("rock")
    names = f"{ROCKS[1].name} to {ROCKS[6].name}"
    note = f"case of Table 2.2, 1 to 6, or its name, {names}, or a rock file of an indentation test (default 4)"
    group.add_argument("--rock", metavar="ROCK", help=note)
    limits = f"{STIFFNESS_LIMITS[0]:g} to {STIFFNESS_LIMITS[1]:g}"
    for way, symbol in (("loading", "k_l"), ("unloading", "k_u")):
        note = f"{symbol} of a rock of your own in N/m, {limits}; give both or none"
        group.add_argument(f"--{way}-stiffness", type=plain_number, metavar="N/M", help=note)


def _add_rig(parser: Parser) -> None:
    group = parser.add_argument_group("rig", "By default that of Table 2.1.")
    for field in dataclasses.fields(Rig):
        note = f"{RIG_UNITS[field.name]} (default {field.default:g})"
        group.add_argument(f"--{field.name.replace('_', '-')}", type=plain_number, metavar="X", help=note)


def _add_model(parser: Parser) -> None:
    group = parser.add_argument_group("model")
    note = (
        "a model.json of a diagnosis: constants of the rig (in place of the options for them), of the rock if it has "
        "any (in place of those too), and effects, with which the hybrid engine is taken; those on sensors are left "
        "aside"
    )
    group.add_argument("--model", metavar="FILE", help=note)


def _add_simulate(parser: Parser) -> None:
    note = "duration in s, 0.001 to 3600 (default 2); of each recording of a campaign (default 0.4)"
    parser.add_argument("--seconds", type=plain_number, metavar="S", help=note)
    note = "samples a second, 100 to 1000000 (default 25600)"
    parser.add_argument("--sample-rate", type=plain_number, default=25600.0, metavar="HZ", help=note)
    note = "fresh: at rest against untouched rock (default); steady: on the motion that follows from there"
    parser.add_argument("--start", default="fresh", metavar="{fresh,steady}", help=note)
    parser.add_argument(
        "--phase", type=plain_number, default=0.0, metavar="RAD", help="of the excitation at the start, in rad"
    )
    note = "exact: closed form (default); hybrid: numerical integration, always taken where a model has effects"
    parser.add_argument("--engine", default="exact", metavar="{exact,hybrid}", help=note)
    parser.add_argument("--out", metavar="FILE.csv", help="where the samples go")
    note = "physics beyond the paper's model, such as contact-rate chi=0.45; repeatable"
    parser.add_argument("--effect", nargs="+", action="append", default=[], metavar=("NAME", "SYMBOL=X"), help=note)
    group = parser.add_argument_group("campaign", "Recordings with sensor noise over the settings of the paper's box.")
    note = "make this folder of recordings and campaign.json, in place of a run at one setting"
    group.add_argument("--campaign", metavar="DIR", help=note)
    group.add_argument("--recordings", type=whole_number, metavar="N", help="how many, 3 to 200 (default 6)")
    group.add_argument("--seed", type=whole_number, metavar="N", help="of settings, phases and noise (default 0)")
    group.add_argument("--file-format", metavar="{csv,mat,mat73,h5,tdms}", help="of the recordings (default csv)")
    add_json(parser)
    _add_controls(parser, required=False)
    _add_rock(parser)
    _add_rig(parser)
    _add_model(parser)
    parser.set_defaults(run=_simulate)


def _add_motion(parser: Parser) -> None:
    note = "look for coexisting motions from so many starts, 1 to 10000; the first is the rig at rest"
    parser.add_argument("--starts", type=whole_number, metavar="N", help=note)
    parser.add_argument(
        "--seed", type=whole_number, metavar="N", help="of the other starts, which are random (default 0)"
    )
    add_json(parser)
    _add_controls(parser)
    _add_rock(parser)
    _add_rig(parser)
    _add_model(parser)
    parser.set_defaults(run=_motion)


def _add_sweep(parser: Parser) -> None:
    note = "frequency (Hz), amplitude (V), pressure (bar), or stiffness (k_l in N/m, k_u keeping its ratio to it)"
    parser.add_argument("--over", required=True, metavar="{frequency,amplitude,pressure,stiffness}", help=note)
    parser.add_argument("--from", dest="first", type=plain_number, required=True, metavar="X", help="first value")
    parser.add_argument("--to", dest="last", type=plain_number, required=True, metavar="X", help="last value")
    parser.add_argument("--step", type=plain_number, required=True, metavar="X", help="from one value to the next")
    note = "up, down, or both, which shows where motions coexist (default both)"
    parser.add_argument("--direction", default="both", metavar="{up,down,both}", help=note)
    parser.add_argument("--out", metavar="FILE.png", help="where the bifurcation diagram goes: .png, .pdf or .svg")
    parser.add_argument("--data", metavar="FILE.csv", help="where the numbers go")
    add_json(parser)
    _add_controls(parser, required=False)
    _add_rock(parser)
    _add_rig(parser)
    _add_model(parser)
    parser.set_defaults(run=_sweep)


def _add_atlas(parser: Parser) -> None:
    parser.add_argument(
        "--rock",
        default="all",
        metavar="ROCKS",
        help="all, or cases, names or rock files with commas: 1,4 (default all)",
    )
    parser.add_argument("--out", required=True, metavar="FILE.nc", help="where the atlas goes, as NetCDF")
    note = "draw it too: slices in this file (.png, .pdf or .svg), the surface and the collapse on p / A beside it"
    parser.add_argument("--plot", metavar="FILE.png", help=note)
    note = "values of frequency, amplitude and pressure over the box of the paper, 2 to 1000 each"
    parser.add_argument("--points", type=whole_number, nargs=3, metavar=("F", "A", "P"), help=note)
    note = "random starts at each point, beside the rig at rest (default 12)"
    parser.add_argument("--starts", type=whole_number, default=12, metavar="N", help=note)
    parser.add_argument("--seed", type=whole_number, default=0, metavar="N", help="of the random starts (default 0)")
    note = "address of a Ray cluster to work on, or local (default: the cores of this machine)"
    parser.add_argument("--cluster", metavar="ADDRESS", help=note)
    add_json(parser)
    _add_rig(parser)
    parser.set_defaults(run=_atlas)


def _add_diagnose(parser: Parser) -> None:
    parser.add_argument("campaign", metavar="CAMPAIGN", help="folder that holds campaign.json")
    note = "folder for report.html, report.json and model.json; made if it is not there"
    parser.add_argument("--out", required=True, metavar="DIR", help=note)
    note = "recordings to leave out, by name, such as r03,r05"
    parser.add_argument("--exclude", default="", metavar="NAMES", help=note)
    note = (
        "look for nothing else than these: parts of the rig (contact, indenter, shaker, sensor), or mechanisms, with "
        "commas between them"
    )
    parser.add_argument("--only", default="", metavar="NAMES", help=note)
    note = "recordings of the drilling rig that are fitted side by side (default: 2)"
    parser.add_argument("--jobs", type=whole_number, default=None, metavar="N", help=note)
    note = "processor seconds after which the search on a drilling rig ends with what has been found (default: none)"
    parser.add_argument("--within", type=plain_number, default=None, metavar="S", help=note)
    add_json(parser)
    parser.set_defaults(run=_diagnose)


def _add_compare(parser: Parser) -> None:
    parser.add_argument("before", metavar="REPORT", help="report.json of one diagnosis")
    parser.add_argument("after", metavar="REPORT", help="report.json of another")
    add_json(parser)
    parser.set_defaults(run=_compare, compiles=False)


def _add_indentation(parser: Parser) -> None:
    note = (
        "csv of force over displacement, with units in its header: displacement (mm), force (kN), and time (s) if any"
    )
    parser.add_argument("curve", metavar="CURVE.csv", help=note)
    note = "what the displacement grows by per force beside the rock: machine, load cell and indenter, in m/N"
    parser.add_argument("--compliance", type=plain_number, metavar="M/N", help=note)
    parser.add_argument("--out", metavar="ROCK.json", help="where the rock goes, which --rock takes")
    parser.add_argument("--name", metavar="NAME", help="of the rock (default: that of the curve)")
    parser.add_argument("--plot", metavar="FILE.png", help="draw curve and fits: .png, .pdf or .svg")
    add_json(parser)
    parser.set_defaults(run=_indentation)


def _add_prove(parser: Parser) -> None:
    note = "folder of the trial; made if it is not there, and gone on with if it holds this very trial"
    parser.add_argument("--out", required=True, metavar="DIR", help=note)
    note = "all randomness comes from it (default 1); one that nobody has looked at makes the trial blind"
    parser.add_argument("--seed", type=whole_number, default=1, metavar="N", help=note)
    note = "how many campaigns (default 60); with --curves, for each mechanism and strength (default 4)"
    parser.add_argument("--campaigns", type=whole_number, metavar="N", help=note)
    note = "campaigns diagnosed side by side (default: as many as there are cores)"
    parser.add_argument("--jobs", type=whole_number, metavar="N", help=note)
    note = "processor seconds for each diagnosis; past that it has given no answer (default 300)"
    parser.add_argument("--limit", type=plain_number, default=300.0, metavar="S", help=note)
    parser.add_argument("--cluster", metavar="ADDRESS", help="address of a Ray cluster that diagnoses, or local")
    kinds = parser.add_mutually_exclusive_group()
    note = "measure detection curves instead: each mechanism alone, from its full strength downwards"
    kinds.add_argument("--curves", dest="kind", action="store_const", const="curves", default="groups", help=note)
    note = "count false alarms instead: nothing is missing, and by turns a constant is wrong"
    kinds.add_argument("--nulls", dest="kind", action="store_const", const="nulls", help=note)
    note = "percussive-drill (default), or one-body: single bodies, shaken or on a driven axis"
    parser.add_argument("--rig", default="percussive-drill", metavar="{percussive-drill,one-body}", help=note)
    note = "check a finished trial in DIR instead: its seal, its reports, its marks, and N diagnoses made again"
    parser.add_argument("--check", type=whole_number, metavar="N", help=note)
    add_json(parser)
    parser.set_defaults(run=_prove)


def _add_paper(parser: Parser) -> None:
    note = "folder for published.json and a figure for each of 2.5, 3.2 and 4.1 to 4.4; made if it is not there"
    parser.add_argument("--out", required=True, metavar="DIR", help=note)
    add_json(parser)
    parser.set_defaults(run=_paper)


# --- What the options mean


def _setting(given: argparse.Namespace) -> Setting:
    return Setting(given.frequency, given.amplitude, given.pressure)


def _rock(given: argparse.Namespace) -> Rock:
    loading, unloading = given.loading_stiffness, given.unloading_stiffness
    if loading is None and unloading is None:
        return rock("4" if given.rock is None else given.rock)
    if given.rock is not None:
        raise InputError("--rock and a stiffness of one's own are both given: give one or the other")
    if loading is None or unloading is None:
        raise InputError("one of --loading-stiffness and --unloading-stiffness is missing: give both, in N/m")
    return Rock(loading, unloading)


def _rig(given: argparse.Namespace) -> Rig:
    constants = {field.name: getattr(given, field.name) for field in dataclasses.fields(Rig)}
    return Rig(**{name: value for name, value in constants.items() if value is not None})


def _plant(given: argparse.Namespace) -> tuple[Rock, Rig, tuple[Chosen, ...]]:
    """The rock, the rig, and the effects beyond the paper's model."""
    if given.model is None:
        return _rock(given), _rig(given), ()
    if not given.model.strip() or "\0" in given.model:
        raise InputError(f"--model is {shown(given.model)}: give the path of a model file")
    model = read_model(given.model)
    rig_options = _options_given(given, [field.name for field in dataclasses.fields(Rig)])
    if rig_options:
        raise InputError(f"--model and {rig_options} are both given: give one of them, the model says which rig")
    rock_options = _options_given(given, ["rock", "loading_stiffness", "unloading_stiffness"])
    if model.rock is not None and rock_options:
        raise InputError(
            f"{rock_options} and --model both say which rock: leave one out, or the stiffnesses out of the model"
        )
    effects = model.on_motion
    if model.on_sensors:
        names = ", ".join(chosen.effect.name for chosen in model.on_sensors)
        _say(f"effects on sensors do not act on the motion, those of the model are left aside: {names}", 0)
    return _rock(given) if model.rock is None else model.rock, model.rig, effects


def _options_given(given: argparse.Namespace, names: Iterable[str]) -> str:
    """Those of these options that were given, as one types them."""
    return " and ".join(f"--{name.replace('_', '-')}" for name in names if getattr(given, name) is not None)


def _progress() -> bool:
    """Whether somebody watches."""
    return sys.stderr.isatty()


# --- The commands


def _simulate(given: argparse.Namespace) -> None:
    from drillenv.dynamics.simulate import simulate

    if given.campaign is not None:
        _simulate_campaign(given)
        return
    setting = _run_setting(given)
    if given.out is not None:
        check_writable(given.out)
    rock, rig, effects = _plant(given)
    effects = (*effects, *_effects_on_motion(given.effect))
    given.seconds = 2.0 if given.seconds is None else given.seconds
    run = simulate(
        setting, rock, rig, given.seconds, given.sample_rate, given.start, given.phase, given.engine, effects
    )
    if given.out is not None:
        run.to_csv(given.out)
    if given.json:
        print_json(_run_summary(run, given, effects))
        return
    place = _place(setting, rock, effects)
    print(f"{place}: {given.seconds:g} s from the {given.start} start, {run.time.size} samples")
    print(f"penetration rate  {_millimetres(run.penetration_rate)}")
    print(f"impacts           {run.impacts.time.size}")
    print(f"peak force        {run.impacts.force.max(initial=0.0):.1f} N")
    print(
        f"energy            {run.work_in:.4f} J put in, {run.lost_in_damper:.4f} J lost in the damper, "
        f"{run.lost_in_rock:.4f} J in the rock; balance open by {run.balance_error:.0e}"
    )
    if given.out is not None:
        print(f"wrote {given.out}")


def _run_setting(given: argparse.Namespace) -> Setting:
    """The setting of a run that makes no campaign."""
    missing = [f"--{name}" for name in CONTROLS if getattr(given, name) is None]
    if missing:
        raise InputError(f"{' and '.join(missing)} of the run are missing: give the whole setting, or --campaign DIR")
    alone = _options_given(given, ["recordings", "seed", "file_format"])
    if alone:
        raise InputError(f"{alone} without --campaign, which it is for: give both or none")
    return _setting(given)


def _effects_on_motion(given: Iterable[Sequence[str]]) -> tuple[Chosen, ...]:
    """The effects of --effect that act on the motion; a word on those on sensors."""
    from drillenv.corrected import Corrected
    from drillenv.recordings.made import effect_from_words

    model = Corrected(effects=tuple(effect_from_words(words) for words in given))
    if model.on_sensors:
        names = ", ".join(chosen.effect.name for chosen in model.on_sensors)
        _say(f"effects on sensors do not act on the motion and are left aside: {names}; --campaign records by them", 0)
    return model.on_motion


def _simulate_campaign(given: argparse.Namespace) -> None:
    from drillenv.recordings.made import effect_from_words, make_campaign

    beside = _options_given(given, [*CONTROLS, "out"])
    if beside:
        raise InputError(f"--campaign and {beside} are both given: leave one out, a campaign has settings of its own")
    rock, rig, effects = _plant(given)
    effects = (*effects, *(effect_from_words(words) for words in given.effect))
    options = {name: getattr(given, name) for name in ("recordings", "seconds", "seed", "file_format")}
    told = {name: value for name, value in options.items() if value is not None}
    folder = make_campaign(given.campaign, rock, rig, effects, sample_rate=given.sample_rate, **told)
    if given.json:
        print_json({"campaign": str(folder), "effects": [effect_record(chosen) for chosen in effects]} | told)
        return
    beyond = f" with {', '.join(chosen.effect.name for chosen in effects)}" if effects else ""
    print(f"wrote {given.campaign}: recordings on {rock.name}{beyond}; next: drillenv campaign plot {given.campaign}")


def _run_summary(run: Run, given: argparse.Namespace, effects: Sequence[Chosen]) -> dict[str, Any]:
    parts = ("work_in", "work_by_drive", "work_by_static", "lost_in_damper", "lost_in_rock", "stored_change")
    return {
        **_where(run.setting, run.rock, effects),
        "seconds": given.seconds,
        "sample_rate": given.sample_rate,
        "start": given.start,
        "samples": run.time.size,
        "penetration_rate": run.penetration_rate,
        "peak_force": run.impacts.force.max(initial=0.0),
        **{part: getattr(run, part) for part in (*parts, "balance_error")},
        "impacts": [
            dict(zip(("time", "force", "speed", "depth"), row, strict=True))
            for row in zip(*(column.tolist() for column in run.impacts[:4]), strict=True)
        ],
        "out": given.out,
    }


def _motion(given: argparse.Namespace) -> None:
    from drillenv.dynamics.motion import motion, motions

    setting = _setting(given)
    if given.starts is None and given.seed is not None:
        raise InputError("--seed is given without --starts, which it is for: give both or none")
    rock, rig, effects = _plant(given)
    where = _where(setting, rock, effects)
    if given.starts is None:
        found = [motion(setting, rock, rig, effects=effects)]
    else:
        seed = count("seed", given.seed or 0, 0, 2**53)
        found = motions(setting, rock, rig, starts=given.starts, seed=seed, effects=effects)
    if given.json and given.starts is None:
        print_json(where | _motion_numbers(found[0]))
    elif given.json:
        listed = [_motion_numbers(each) | {"share": each.share} for each in found]
        print_json(where | {"starts": given.starts, "seed": given.seed or 0, "motions": listed})
    else:
        print(_place(setting, rock, effects))
        for each in found:
            _print_motion(each, given.starts)


def _motion_numbers(motion: Motion) -> dict[str, Any]:
    names = ("label", "period", "impacts", "contacts", "penetration_rate", "peak_force", "impact_speed", "stable")
    return {
        **{name: getattr(motion, name) for name in names},
        # without a period there are none
        "multipliers": [[value.real, value.imag] for value in motion.multipliers.tolist() if motion.period],
        "exponent": motion.exponent,
    }


def _print_motion(motion: Motion, starts: int | None) -> None:
    share = "" if starts is None else f"  ({100 * motion.share:.1f} % of {starts} starts)"
    per = "a motion" if motion.period else "a period in the mean"
    print(f"{motion.label}{share}")
    print(f"  impacts           {motion.impacts:g} in {motion.contacts:g} contacts, {per}")
    print(f"  penetration rate  {_millimetres(motion.penetration_rate)}")
    print(f"  peak force        {motion.peak_force:.1f} N")
    print(f"  impact speed      {motion.impact_speed:.4f} m/s")
    if motion.period:
        listed = ", ".join(f"{value:.4f}" for value in motion.multipliers.tolist())
        print(f"  multipliers       {listed} ({'stable' if motion.stable else 'not stable'})")
    else:
        print(f"  largest Lyapunov exponent  {motion.exponent:.3f} 1/s")


def _sweep(given: argparse.Namespace) -> None:
    from drillenv.atlas import sweep

    over = choice("over", given.over, tuple(SWEPT))
    if given.out is None and given.data is None and not given.json:
        raise InputError("nothing would be kept of this sweep: give --out, --data or --json")
    for path in (given.out, given.data):
        if path is not None:
            check_writable(path)
    if given.out is not None:
        choice("the ending of --out", Path(given.out).suffix.lower(), (".png", ".pdf", ".svg"))
    setting = _swept_setting(given, over)
    rock, rig, effects = _plant(given)
    values = (given.first, given.last, given.step)
    result = sweep(setting, over, *values, rock, rig, given.direction, _progress(), effects=effects)
    if given.data is not None:
        result.to_csv(given.data)
    if given.out is not None:
        result.plot(given.out)
    if given.json:
        print_json(_where(setting, rock, effects, without=over) | {"over": over, "points": list(_sweep_points(result))})
        return
    for direction in result.directions:
        print(f"{direction}:")
        for first, last, label in _stretches(result.values.tolist(), result.labels(direction).tolist()):
            print(f"  {first:10.6g} to {last:10.6g} {SWEPT[over]}  {label}")
    for path in (given.out, given.data):
        if path is not None:
            print(f"wrote {path}")


def _swept_setting(given: argparse.Namespace, over: str) -> Setting:
    """The controls that stay, and the first value of the swept one."""
    values: dict[str, Any] = {name: getattr(given, name) for name in CONTROLS}
    missing = [f"--{name}" for name, value in values.items() if value is None and name != over]
    if missing:
        raise InputError(f"a sweep over {over} holds the other controls: give {' and '.join(missing)} too")
    if over in CONTROLS:
        if values[over] is not None:
            raise InputError(f"--{over} is given in a sweep over it: leave it out, --from and --to say it")
        values[over] = given.first
    return Setting(**values)


def _sweep_points(result: Sweep) -> Iterable[dict[str, Any]]:
    names = ("period", "impacts", "contacts", "penetration_rate", "peak_force", "impact_speed", "stable", "exponent")
    for direction in result.directions:
        points, labels = result.points(direction), result.labels(direction).tolist()
        for point, label in zip(points, labels, strict=True):
            peaks = point["peak_forces"][: point["peaks"]].tolist()
            head = {"direction": direction, "value": point["value"].item(), "label": label}
            yield head | {name: point[name].item() for name in names} | {"peak_forces": peaks}


def _stretches(values: Sequence[float], labels: Sequence[str]) -> Iterable[tuple[float, float, str]]:
    """First and last value of each stretch with one label."""
    begin = 0
    for at in range(1, len(labels) + 1):
        if at == len(labels) or labels[at] != labels[begin]:
            yield values[begin], values[at - 1], labels[begin]
            begin = at


def _atlas(given: argparse.Namespace) -> None:
    rocks = given.rock if given.rock.strip().lower() == "all" else [rock(part) for part in given.rock.split(",")]
    rig = _rig(given)
    axes = _axes(given.points)
    check_writable(given.out)
    if given.plot is not None:
        check_writable(given.plot)
        choice("the ending of --plot", Path(given.plot).suffix, (".png", ".pdf", ".svg"))
    from drillenv.atlas import atlas

    dataset = atlas(
        rocks,
        **axes,
        starts=given.starts,
        seed=given.seed,
        rig=rig,
        progress=_progress(),
        cluster=given.cluster,
        out=given.out,
    )
    pictures: list[str] = []
    if given.plot is not None:
        from drillenv.atlas.p11_figures import plot_atlas

        pictures = [str(path) for path in plot_atlas(dataset, given.plot)]
    summary = {
        "out": given.out,
        "pictures": pictures,
        "points": dict(dataset["exists"].sizes),
        "exists": float(dataset["exists"].mean()),
        "only": float(dataset["only"].mean()),
        "boundary_points": dataset.sizes["boundary_point"],
    }
    if given.json:
        print_json(summary)
        return
    print(f"P-1-I-1 exists at {100 * summary['exists']:.1f} % of the points, and is the only motion at ", end="")
    print(f"{100 * summary['only']:.1f} %; {summary['boundary_points']} points on its boundary")
    print(f"wrote {', '.join([given.out, *pictures])}")


def _axes(points: Sequence[int] | None) -> dict[str, Any]:
    """So many values of each control over the box of the paper; none where the atlas' own are wanted."""
    if points is None:
        return {}
    axes: dict[str, Any] = {}
    for (name, (_metavar, _meaning, _limits, (low, high))), wanted in zip(CONTROLS.items(), points, strict=True):
        n = count(f"--points of {name}", wanted, 2, 1000)
        axes[name] = [low + (high - low) * i / (n - 1) for i in range(n)]
    return axes


def _diagnose(given: argparse.Namespace) -> int:
    folder = _folder_option(given.out)
    from drillenv.diagnosis.report import diagnose

    exclude, only = (_names(text) for text in (given.exclude, given.only))
    within = math.inf if given.within is None else number("--within", given.within, 0.0, 1e9, "s")
    report = diagnose(given.campaign, _stages(), exclude, given.jobs, only, interruptible=True, within=within)
    report.write(folder)
    if given.json:
        print_json(report.record)
    else:
        print(report.text())
        print(f"wrote report.html, report.json and model.json to {folder}")
    if report.record.get("unfinished"):
        text = f"ended while {report.record['unfinished']}: the report is unfinished"
        return _say(text, INTERRUPTED if given.within is None else 0)
    return 0


def _names(text: str) -> list[str]:
    """Names with commas between them."""
    return [name.strip() for name in text.split(",") if name.strip()]


def _stages() -> Callable[[str], object] | None:
    """Tells on stderr where a diagnosis is: at a terminal every step, elsewhere a line for each stage."""
    from drillenv.diagnosis.progress import MARK

    every = _progress()

    def note(text: str) -> None:
        if every or text.startswith(MARK):
            print(text, file=sys.stderr, flush=True)

    return note


def _compare(given: argparse.Namespace) -> None:
    from drillenv.diagnosis.compare import compare, compared_text, read_report

    found = compare(read_report(given.before), read_report(given.after))
    if given.json:
        print_json(found)
        return
    print(compared_text(found))


def _indentation(given: argparse.Namespace) -> None:
    if given.out is not None:
        choice("the ending of --out", Path(given.out).suffix.lower(), (".json",))
        check_writable(given.out)
    if given.plot is not None:
        choice("the ending of --plot", Path(given.plot).suffix.lower(), (".png", ".pdf", ".svg"))
        check_writable(given.plot)
    from drillenv.indentation import fit_indentation

    test = fit_indentation(given.curve, given.compliance)
    if given.out is not None:
        test.write_rock(given.out, given.name)
    if given.plot is not None:
        test.plot(given.plot)
    if given.json:
        print_json(test.record())
        return
    print(test.text())
    for path in (given.out, given.plot):
        if path is not None:
            print(f"wrote {path}")


def _prove(given: argparse.Namespace) -> None:
    folder = _folder_option(given.out)
    from drillenv.blind import trial

    def note(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    if given.check is not None:
        trial.check_trial(folder, count("--check", given.check, 0, 10_000), given.jobs, note)
        print("the trial is what its seed and the diagnosis give")
        return
    campaigns = given.campaigns if given.campaigns is not None else (4 if given.kind == trial.CURVES else 60)
    record = trial.prove(
        folder, given.seed, campaigns, given.jobs, given.limit, given.cluster, given.kind, given.rig, note, True
    )
    if given.json:
        print_json(record)
        return
    for name, group in record["summary"]["groups"].items():
        right, named = group["right"], group["named"]
        print(f"{name:<22}  right {right['hits']:>3} of {right['of']:<3}  named {named['hits']:>3}")
    print(f"wrote trial.json and trial.html to {folder}")


def _folder_option(out: str) -> Path:
    """The folder that --out names."""
    if not out.strip() or "\0" in out:
        raise InputError("--out is empty: give the name of a folder")
    folder = Path(out)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out is {shown(out)}, which is a file: give the name of a folder")
    return folder


def _add_demo(parser: Parser) -> None:
    parser.add_argument("--out", default="demo", metavar="DIR", help="folder of the page (default demo)")
    parser.set_defaults(run=_demo, compiles=False)


def _demo(given: argparse.Namespace) -> None:
    folder = _folder_option(given.out)
    from drillenv.demo import demonstrate

    demonstrate(folder, lambda text: print(text, flush=True))


def _paper(given: argparse.Namespace) -> None:
    folder = _folder_option(given.out)
    made = _make_folder(folder)
    try:
        check_writable(folder / "published.json")
        from drillenv.paper import reproduce

        rows = reproduce(folder, _progress())
    except BaseException:
        for each in made:
            if not any(each.iterdir()):
                each.rmdir()
        raise
    if given.json:
        print_json(rows)
        return
    print(_columns("figure", "setting", "published", "computed", ""))
    for row in rows:
        print(_paper_line(row))
    agreeing = sum(bool(row["agrees"]) for row in rows)
    print(f"{agreeing} of {len(rows)} agree; wrote published.json and the figures to {folder}")


def _paper_line(row: Mapping[str, Any]) -> str:
    """One row of published.json on one line."""
    verdict = "agrees" if row["agrees"] else "differs"
    if isinstance(row.get("difference"), float):
        verdict += f", {row['difference']:+.4g}"
    where = _briefly(row["setting"])
    if "rock" in row:
        where = f"rock {row['rock']}, {where}"
    return _columns(row["figure"], where, _briefly(row["published"]), _briefly(row["computed"]), verdict)


def _columns(figure: str, setting: str, published: str, computed: str, verdict: str) -> str:
    return f"{figure:<6}  {setting:<30}  {published:<34}  {computed:<34}  {verdict}".rstrip()


def _briefly(value: object) -> str:
    """A value of published.json in at most 34 characters."""
    if isinstance(value, Mapping):
        text = ", ".join(f"{part:g} {SWEPT[name]}" if name in SWEPT else str(part) for name, part in value.items())
    elif isinstance(value, list | tuple):
        text = ", ".join(_briefly(part).removesuffix(".0") for part in value)
    else:
        text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 34 else f"{text[:31]}..."


def _make_folder(folder: Path) -> list[Path]:
    """Make a folder and those above it. Returns those made, the innermost first."""
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    made_folder(folder)
    return missing


# --- How it is printed


def _place(setting: Setting, rock: Rock, effects: Sequence[Chosen] = ()) -> str:
    beyond = f" with {', '.join(chosen.effect.name for chosen in effects)}" if effects else ""
    return f"{rock.name} at {setting.frequency:g} Hz, {setting.amplitude:g} V, {setting.pressure:g} bar{beyond}"


def _millimetres(rate: float) -> str:
    return f"{1e3 * rate:.4f} mm/s"


def _where(setting: Setting, rock: Rock, effects: Sequence[Chosen] = (), without: str = "") -> dict[str, Any]:
    """The setting, the rock, and the effects where there are any, for JSON."""
    controls = {name: getattr(setting, name) for name in CONTROLS if name != without}
    pair = {"name": rock.name, "loading_stiffness": rock.loading_stiffness}
    beyond = {"effects": [effect_record(chosen) for chosen in effects]} if effects else {}
    return {"rock": pair | {"unloading_stiffness": rock.unloading_stiffness}, **controls, **beyond}


if __name__ == "__main__":
    sys.exit(main())
