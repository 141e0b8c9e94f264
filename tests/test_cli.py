"""The command line: what it prints and writes, and how it refuses."""

import csv
import functools
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from drillenv import cli
from drillenv.cli_options import commands_below
from drillenv.dynamics.effects import make
from drillenv.dynamics.motion import motion
from drillenv.dynamics.simulate import simulate
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS, Rock

SETTING = ["--frequency", "120", "--amplitude", "0.45", "--pressure", "1.0"]
SWEEP = ["sweep", "--over", "frequency", "--from", "110", "--to", "112", "--step", "1", *SETTING[2:]]
COMMAND = [sys.executable, "-m", "drillenv.cli"]


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def run(capsys):
    """Runs a command that must go well; returns what it prints."""

    def go(*arguments):
        assert cli.main(list(arguments)) == 0
        printed = capsys.readouterr()
        assert printed.err == ""
        return printed.out

    return go


def as_json(text):
    """Strict JSON: no NaN, no Infinity."""

    def refuse(constant):
        raise AssertionError(constant)

    return json.loads(text, parse_constant=refuse)


# --- simulate


def test_simulate_writes_the_run(run, tmp_path):
    printed = run("simulate", "--rock", "4", *SETTING, "--seconds", "0.5", "--out", "run.csv")
    assert "run.csv" in printed
    with open("run.csv", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert header == [
        "time_s",
        "excitation_V",
        "force_N",
        "acceleration_m_s2",
        "shaker_position_m",
        "indenter_position_m",
        "penetration_m",
    ]
    wanted = simulate(Setting(120.0, 0.45, 1.0), 4, seconds=0.5)
    table = np.array(rows, dtype=float).T
    np.testing.assert_array_equal(table[2], wanted.force)
    np.testing.assert_array_equal(table[6], wanted.penetration)
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]


def test_simulate_tells_json(run):
    options = ["--start", "steady", "--phase", "1.5", "--seconds", "0.2", "--sample-rate", "1000", "--rock", "2"]
    told = as_json(run("simulate", *SETTING, *options, "--json"))
    wanted = simulate(Setting(120.0, 0.45, 1.0), 2, seconds=0.2, sample_rate=1000.0, start="steady", phase=1.5)
    assert told["penetration_rate"] == wanted.penetration_rate
    assert told["work_in"] == wanted.work_in
    assert told["balance_error"] < 1e-9
    assert [each["force"] for each in told["impacts"]] == wanted.impacts.force.tolist()
    assert set(told["impacts"][0]) == {"time", "force", "speed", "depth"}
    assert told["samples"] == 201


def test_rock_and_rig_of_ones_own(run):
    own = ["--loading-stiffness", "21.4e6", "--unloading-stiffness", "25.05e6"]
    options = [*SETTING, "--seconds", "0.1", "--json"]
    table = as_json(run("simulate", *options, "--rock", "sandstone2-indenter30"))
    same = as_json(run("simulate", *options, *own))
    assert same["rock"]["name"] == "custom"
    assert same["impacts"] == table["impacts"]
    damped = as_json(run("simulate", *options, "--damping", "4000"))
    assert damped["impacts"] != table["impacts"]


def test_hybrid_engine_by_option(run):
    told = as_json(run("simulate", *SETTING, "--seconds", "0.05", "--engine", "hybrid", "--json"))
    exact = as_json(run("simulate", *SETTING, "--seconds", "0.05", "--json"))
    assert told["work_in"] == pytest.approx(exact["work_in"], rel=1e-9)


# --- motion


def test_motion_tells_json(run):
    told = as_json(run("motion", "--rock", "4", *SETTING, "--json"))
    wanted = motion(Setting(120.0, 0.45, 1.0), 4)
    assert (told["label"], told["period"], told["impacts"], told["contacts"]) == ("P-1-I-1", 1, 1, 1)
    assert told["stable"] is True
    for name in ("penetration_rate", "peak_force", "impact_speed", "exponent"):
        assert told[name] == getattr(wanted, name)
    assert [complex(*pair) for pair in told["multipliers"]] == wanted.multipliers.tolist()


def test_chaos_is_still_json(run):
    told = as_json(run("motion", "--frequency", "105", *SETTING[2:], "--json"))
    assert (told["label"], told["period"], told["stable"]) == ("chaotic", 0, False)
    assert told["exponent"] > 1.0
    assert told["multipliers"] == []


def test_motions_of_many_starts(run):
    options = ["motion", *SETTING, "--starts", "8", "--seed", "3"]
    told = as_json(run(*options, "--json"))
    assert sum(each["share"] for each in told["motions"]) == pytest.approx(1.0)
    assert told["motions"][0]["label"] == "P-1-I-1"
    assert run(*options) == run(*options)


def test_motion_for_people(run):
    printed = run("motion", *SETTING)
    assert "P-1-I-1" in printed
    assert "mm/s" in printed


# --- A corrected model

MODEL = {
    "format": "drillenv-model/1",
    "constants": {"damping": 2790.0, "loading_stiffness": 21.9e6, "unloading_stiffness": 25.1e6},
    "effects": [{"name": "contact-rate", "parameters": {"chi": 0.52, "c_d": 0.0, "p_d": 0.0}}],
}
OWN = Rock(21.9e6, 25.1e6)
RATE = [make("contact-rate", chi=0.52)]


def write_model(**changes):
    with open("model.json", "w", encoding="utf-8") as file:
        json.dump(MODEL | changes, file)


def test_motion_of_a_model(run):
    write_model()
    told = as_json(run("motion", *SETTING, "--model", "model.json", "--json"))
    wanted = motion(Setting(120.0, 0.45, 1.0), OWN, Rig(damping=2790.0), effects=RATE)
    for name in ("label", "penetration_rate", "peak_force", "exponent"):
        assert told[name] == getattr(wanted, name)
    assert told["effects"] == MODEL["effects"]
    assert told["rock"] == {"name": "corrected", "loading_stiffness": 21.9e6, "unloading_stiffness": 25.1e6}
    assert "with contact-rate" in run("motion", *SETTING, "--model", "model.json")
    many = as_json(run("motion", *SETTING, "--model", "model.json", "--starts", "2", "--json"))
    assert many["motions"][0]["label"] == wanted.label


def test_simulate_a_model(run):
    write_model()
    told = as_json(run("simulate", *SETTING, "--model", "model.json", "--seconds", "0.2", "--json"))
    wanted = simulate(Setting(120.0, 0.45, 1.0), OWN, Rig(damping=2790.0), seconds=0.2, effects=RATE)
    assert [each["force"] for each in told["impacts"]] == wanted.impacts.force.tolist()
    assert told["effects"] == MODEL["effects"]


def test_sweep_a_model(run):
    write_model()
    told = as_json(run(*SWEEP, "--direction", "up", "--model", "model.json", "--json"))
    wanted = motion(Setting(112.0, 0.45, 1.0), OWN, Rig(damping=2790.0), effects=RATE)
    assert told["points"][2]["label"] == wanted.label
    assert told["points"][2]["peak_force"] == pytest.approx(wanted.peak_force, rel=1e-8)


def test_model_without_a_rock_takes_one(run):
    write_model(constants={"damping": 2790.0}, effects=[])
    told = as_json(run("motion", *SETTING, "--model", "model.json", "--rock", "2", "--json"))
    assert told["peak_force"] == motion(Setting(120.0, 0.45, 1.0), 2, Rig(damping=2790.0)).peak_force
    assert "effects" not in told
    assert as_json(run("motion", *SETTING, "--model", "model.json", "--json"))["rock"]["name"] == ROCKS[4].name


def test_effects_on_sensors_are_left_aside_aloud(capsys):
    sensors = [{"name": name, "parameters": {}} for name in ("sensor-offset", "mains-hum")]
    write_model(effects=[sensors[0], *MODEL["effects"], sensors[1]])
    for command in (["motion", *SETTING], ["simulate", *SETTING, "--seconds", "0.02"], [*SWEEP, "--direction", "up"]):
        assert cli.main([*command, "--model", "model.json", "--json"]) == 0
        printed = capsys.readouterr()
        assert as_json(printed.out)["effects"] == MODEL["effects"]
        assert len(printed.err.splitlines()) == 1
        assert "sensor-offset, mains-hum" in printed.err


MODEL_ALONE = [["motion", *SETTING], ["simulate", *SETTING, "--seconds", "0.01"], [*SWEEP, "--json"]]
CONTRADICTIONS = {
    "rock": (["--rock", "4"], {}, "which rock"),
    "stiffnesses": (["--loading-stiffness", "2e7", "--unloading-stiffness", "3e7"], {}, "which rock"),
    "one stiffness": (["--unloading-stiffness", "3e7"], {}, "which rock"),
    "damping": (["--damping", "2450"], {}, "--damping"),
    "a constant the model leaves out": (["--shaker-mass", "200"], {}, "--shaker-mass"),
    "unknown effect": ([], {"effects": [{"name": "gravity", "parameters": {}}]}, "gravity"),
    "one-body effect": ([], {"effects": [{"name": "dry-friction", "parameters": {"fc": 5.0}}]}, "one-body"),
    "effect twice": ([], {"effects": MODEL["effects"] * 2}, "twice"),
    "another format": ([], {"format": "drillenv-report/1"}, "format"),
}


@pytest.mark.parametrize("command", MODEL_ALONE, ids=lambda command: command[0])
@pytest.mark.parametrize(("options", "changes", "said"), CONTRADICTIONS.values(), ids=CONTRADICTIONS)
def test_model_that_cannot_be_taken(command, options, changes, said, capsys):
    write_model(**changes)
    assert cli.main([*command, "--model", "model.json", *options]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1
    assert said in printed.err


# --- sweep, atlas, paper


def test_sweep_draws_and_writes(run):
    printed = run(*SWEEP, "--out", "fig.png", "--data", "fig.csv")
    assert "P-1-I-1" in printed
    with open("fig.png", "rb") as file:
        assert file.read(8) == b"\x89PNG\r\n\x1a\n"
    with open("fig.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["frequency_Hz"]) for row in rows[:3]] == [110.0, 111.0, 112.0]
    assert sorted(os.listdir()) == ["fig.csv", "fig.png"]


def test_sweep_tells_json(run):
    told = as_json(run(*SWEEP, "--direction", "down", "--json"))
    assert (told["over"], told["amplitude"], told["pressure"]) == ("frequency", 0.45, 1.0)
    assert [point["value"] for point in told["points"]] == [110.0, 111.0, 112.0]
    assert {point["direction"] for point in told["points"]} == {"down"}
    one = as_json(run("motion", "--frequency", "112", *SETTING[2:], "--json"))
    assert told["points"][2]["label"] == one["label"]
    assert told["points"][2]["peak_force"] == pytest.approx(one["peak_force"], rel=1e-9)


@pytest.mark.parametrize(
    ("over", "first", "last", "step"),
    [("amplitude", "0.5", "0.51", "0.01"), ("pressure", "0.9", "1", "0.1"), ("stiffness", "21e6", "22e6", "1e6")],
)
def test_sweep_over_each(run, over, first, last, step):
    held = [
        f"--{name}={value}"
        for name, value in (("frequency", 120), ("amplitude", 0.45), ("pressure", 1))
        if name != over
    ]
    told = as_json(run("sweep", "--over", over, "--from", first, "--to", last, "--step", step, *held, "--json"))
    assert [point["value"] for point in told["points"]] == pytest.approx([float(first), float(last)] * 2)
    assert over not in told


@pytest.mark.slow
def test_atlas_is_written(run):
    options = ["atlas", "--rock", "4,2", "--points", "2", "2", "2", "--starts", "1", "--out", "atlas.nc"]
    options += ["--plot", "map.png"]
    told = as_json(run(*options, "--json"))
    assert told["points"] == {"rock": 2, "frequency": 2, "amplitude": 2, "pressure": 2}
    assert 0.0 <= told["only"] <= told["exists"] <= 1.0
    assert (
        sorted(os.listdir())
        == ["atlas.nc", "map.png", "map_ratio.png", "map_surface.png"]
        == sorted([told["out"], *told["pictures"]])
    )


def test_paper_prints_its_rows(run, monkeypatch):
    rows = [
        {"figure": "4.1", "setting": "50 Hz", "published": "P-1-I-4", "computed": "P-1-I-4", "agrees": True},
        {"figure": "3.2", "setting": "boundary", "published": 102.0, "computed": 102.63, "agrees": False},
    ]
    module = type(sys)("drillenv.paper")
    module.reproduce = lambda out, progress: rows
    monkeypatch.setitem(sys.modules, "drillenv.paper", module)
    assert as_json(run("paper", "--out", "out/paper", "--json")) == rows
    printed = run("paper", "--out", "out/paper")
    assert "1 of 2 agree" in printed
    assert "differs" in printed


# --- What is refused

GOOD_SIMULATE = ["simulate", *SETTING, "--seconds", "0.01", "--out", "run.csv"]
BAD = [
    [],
    ["drill"],
    ["--bogus"],
    ["simulate"],
    ["motion", "--frequency"],
    ["motion", *SETTING, "--bogus"],
    ["motion", *SETTING, "stray"],
    ["motion", *SETTING, "--js"],
    ["motion", *SETTING[:4]],
    ["motion", "--frequency", "fast", *SETTING[2:]],
    ["motion", "--frequency", "fast\nand loose", *SETTING[2:]],
    ["motion", "--frequency", "", *SETTING[2:]],
    ["motion", "--frequency", "nan", *SETTING[2:]],
    ["motion", "--frequency", "inf", *SETTING[2:]],
    ["motion", "--frequency", "-inf", *SETTING[2:]],
    ["motion", "--frequency", "-120", *SETTING[2:]],
    ["motion", "--frequency", "0", *SETTING[2:]],
    ["motion", "--frequency", "1e400", *SETTING[2:]],
    ["motion", *SETTING[:2], "--amplitude", "450", *SETTING[4:]],
    ["motion", *SETTING[:4], "--pressure", "100"],
    ["motion", *SETTING, "--rock", "7"],
    ["motion", *SETTING, "--rock", "4.0"],
    ["motion", *SETTING, "--rock", ""],
    ["motion", *SETTING, "--rock", "granite\n"],
    ["motion", *SETTING, "--loading-stiffness", "2e7"],
    ["motion", *SETTING, "--loading-stiffness", "2e7", "--unloading-stiffness", "1e7"],
    ["motion", *SETTING, "--loading-stiffness", "21.4", "--unloading-stiffness", "25.05"],
    ["motion", *SETTING, "--rock", "4", "--loading-stiffness", "2e7", "--unloading-stiffness", "3e7"],
    ["motion", *SETTING, "--damping", "2.45"],
    ["motion", *SETTING, "--shaker-mass", "nan"],
    ["motion", *SETTING, "--model", "missing.json"],
    ["motion", *SETTING, "--model", "."],
    ["motion", *SETTING, "--model", ""],
    ["motion", *SETTING, "--model", "x\0y"],
    [*SWEEP, "--json", "--model", "missing.json"],
    [*GOOD_SIMULATE, "--model", "missing.json"],
    ["atlas", "--out", "atlas.nc", "--model", "model.json"],
    ["motion", *SETTING, "--starts", "0"],
    ["motion", *SETTING, "--starts", "2.5"],
    ["motion", *SETTING, "--starts", "8", "--seed", "-1"],
    ["motion", *SETTING, "--starts", "8", "--seed", "x"],
    ["motion", *SETTING, "--seed", "1"],
    [*GOOD_SIMULATE, "--seconds", "0"],
    [*GOOD_SIMULATE, "--seconds", "nan"],
    [*GOOD_SIMULATE, "--seconds", "1e9"],
    [*GOOD_SIMULATE, "--sample-rate", "25.6"],
    [*GOOD_SIMULATE, "--seconds", "3600", "--sample-rate", "1e6"],
    [*GOOD_SIMULATE, "--phase", "nan"],
    [*GOOD_SIMULATE, "--start", "cold"],
    [*GOOD_SIMULATE, "--engine", "steam"],
    [*GOOD_SIMULATE, "--out", "missing/run.csv"],
    [*GOOD_SIMULATE, "--out", "."],
    [*GOOD_SIMULATE, "--out", ""],
    [*GOOD_SIMULATE, "--out", "x" * 300],
    [*SWEEP],
    [*SWEEP, "--json", "--frequency", "100"],
    [*SWEEP, "--json", "--over", "depth"],
    [*SWEEP, "--json", "--over", "amplitude"],
    [*SWEEP, "--json", "--step", "0"],
    [*SWEEP, "--json", "--step", "-1"],
    [*SWEEP, "--json", "--step", "nan"],
    [*SWEEP, "--json", "--step", "1e-9"],
    [*SWEEP, "--json", "--from", "112", "--to", "110"],
    [*SWEEP, "--json", "--to", "1e6"],
    [*SWEEP, "--json", "--direction", "left"],
    [*SWEEP, "--out", "fig.bmpx"],
    [*SWEEP, "--out", "fig"],
    [*SWEEP, "--out", "missing/fig.png"],
    [*SWEEP, "--data", "fig.csv", "--out", "missing/fig.png"],
    [*SWEEP[:-2], "--data", "fig.csv"],
    ["atlas"],
    ["atlas", "--out", "missing/atlas.nc"],
    ["atlas", "--out", "atlas.nc", "--rock", "4,9"],
    ["atlas", "--out", "atlas.nc", "--rock", "4,4"],
    ["atlas", "--out", "atlas.nc", "--rock", ","],
    ["atlas", "--out", "atlas.nc", "--points", "1", "2", "2"],
    ["atlas", "--out", "atlas.nc", "--points", "2", "2"],
    ["atlas", "--out", "atlas.nc", "--starts", "0"],
    ["atlas", "--out", "atlas.nc", "--seed", "-1"],
    ["atlas", "--out", "atlas.nc", "--plot", "atlas.bmp"],
    ["atlas", "--out", "atlas.nc", "--plot", "missing/atlas.png"],
    ["motion", *SETTING, "--rock", "missing.json"],
    ["motion", *SETTING, "--rock", "x\0y.json"],
    ["motion", *SETTING, "--rock", ".json"],
    ["atlas", "--out", "atlas.nc", "--rock", "4,missing.json"],
    ["indentation"],
    ["indentation", ""],
    ["indentation", "."],
    ["indentation", "missing.csv"],
    ["indentation", "missing.csv", "--compliance", "stiff"],
    ["indentation", "missing.csv", "--out", "rock.txt"],
    ["indentation", "missing.csv", "--out", "missing/rock.json"],
    ["indentation", "missing.csv", "--plot", "fig.bmp"],
    ["paper"],
    ["paper", "--out", ""],
    ["paper", "--out", "\0"],
    ["paper", "--out", os.devnull],
    ["paper", "--out", os.path.join(os.devnull, "paper")],
]


@pytest.mark.parametrize(
    "arguments", BAD, ids=lambda arguments: " ".join(arguments)[:60].encode("unicode_escape").decode()
)
def test_bad_input_is_refused_in_one_line(arguments, capsys, tmp_path):
    assert cli.main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("drillenv: ")
    assert len(printed.err.splitlines()) == 1
    assert len(printed.err) > len("drillenv: \n")
    assert "Traceback" not in printed.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["motion", *SETTING, "--bogus"], [*GOOD_SIMULATE, "--out", "missing/run.csv"]])
def test_exit_code_of_the_process(arguments):
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1


# --- The process


@pytest.mark.parametrize("command", [[], ["simulate"], ["motion"], ["sweep"], ["atlas"], ["indentation"], ["paper"]])
def test_help_says_units_and_ranges(command, capsys):
    assert cli.main([*command, "--help"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    for option in [] if not command or command in (["paper"], ["indentation"]) else ["kg", "N s/m"]:
        assert option in printed
    if command in (["simulate"], ["motion"], ["sweep"]):
        assert "10 to 250" in printed
        assert "in bar, 0.2 to 5" in printed


@pytest.mark.parametrize("command", list(commands_below(cli._parser())), ids=lambda command: command.prog)
def test_help_ends_with_an_example_that_parses(command, capsys):
    assert cli.main([*command.prog.split()[1:], "--help"]) == 0
    last = capsys.readouterr().out.splitlines()[-1].strip()
    name, *arguments = shlex.split(last)
    assert name == "drillenv" and last.startswith(command.prog)
    assert cli._parser().parse_args(arguments).command == command.prog.split()[1]


def completed(script, *words):
    """What bash offers for the last of these words."""
    lines = (
        f"source {script}", f"COMP_WORDS=({' '.join(map(shlex.quote, words))})", f"COMP_CWORD={len(words) - 1}",
        "_shtab_drillenv", 'printf "%s\\n" "${COMPREPLY[@]}"',
    )  # fmt: skip
    done = subprocess.run(["bash", "-c", "\n".join(lines)], capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_commands_options_and_values(run, tmp_path):
    script = tmp_path / "drillenv.bash"
    script.write_text(run("--print-completion", "bash"), encoding="utf-8")
    assert completed(script, "drillenv", "mo") == ["motion"]
    assert completed(script, "drillenv", "campaign", "ch") == ["check"]
    assert completed(script, "drillenv", "sweep", "--dir") == ["--direction"]
    assert completed(script, "drillenv", "simulate", "--engine", "") == ["exact", "hybrid"]
    assert "--algo" in completed(script, "drillenv", "train", "--al")


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_other_shells_get_a_script_too(run, shell):
    assert "drillenv" in run("--print-completion", shell)


def test_version(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("drillenv ")


def test_interrupt(capsys, monkeypatch):
    def interrupted(*_given):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "_setting", interrupted)
    assert cli.main(["motion", *SETTING]) == 130
    assert capsys.readouterr().err == "drillenv: interrupted\n"


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_interrupt_while_writing_leaves_no_file(tmp_path):
    arguments = ["simulate", *SETTING, "--seconds", "120", "--sample-rate", "1e5", "--out", "run.csv"]
    # a shell starts what runs in its background with the signal ignored
    heeded = functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with subprocess.Popen([*COMMAND, *arguments], stderr=subprocess.PIPE, text=True, preexec_fn=heeded) as process:
        deadline = time.monotonic() + 60
        while not sum(entry.stat().st_size for entry in os.scandir(tmp_path)):
            assert time.monotonic() < deadline
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        _out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err == "drillenv: interrupted\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="pipes")
def test_closed_pipe_is_quiet():
    arguments = ["simulate", *SETTING, "--seconds", "60", "--sample-rate", "100", "--json"]
    with subprocess.Popen([*COMMAND, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "{\n"
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == ""
    assert process.returncode == 141


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_full_disk_is_one_line():
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run([*COMMAND, "motion", *SETTING], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("drillenv: cannot write")
