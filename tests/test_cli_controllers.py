"""The commands around controllers import what they need, when they need it, and say what is not installed."""

import json
import subprocess
import sys

import pytest

CODE = """
import json, sys, time
for name in {missing!r}:
    sys.modules[name] = None
begin = time.perf_counter()
from drillenv.cli import main
code = main({arguments!r})
loaded = [name for name in ("torch", "stable_baselines3", "numba", "matplotlib") if name in sys.modules]
print(json.dumps([code, time.perf_counter() - begin, loaded]), file=sys.stderr)
"""


def run(folder, *arguments, missing=()):
    code = CODE.format(arguments=list(arguments), missing=list(missing))
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True)
    lines = done.stderr.splitlines()
    return done.stdout, lines[:-1], *json.loads(lines[-1])


@pytest.mark.slow
def test_help_of_all_is_light(tmp_path):
    run(tmp_path, "--help")
    out, _, code, seconds, loaded = min((run(tmp_path, "--help") for _ in range(3)), key=lambda each: each[3])
    assert code == 0 and seconds < 1.0 and loaded == []
    for name in ("league", "train", "export", "film"):
        assert name in out


@pytest.mark.slow
@pytest.mark.parametrize("name", ["league", "train", "export", "film", "record"])
def test_help_needs_no_torch(name, tmp_path):
    out, said, code, _, loaded = run(tmp_path, name, "--help")
    assert code == 0 and said == [] and "torch" not in loaded and "stable_baselines3" not in loaded
    assert "--out" in out or (name == "league" and "--controllers" in out)


@pytest.mark.slow
def test_the_league_needs_no_torch(tmp_path):
    short = ["--controllers", "fixed", "shipped", "--scenario", "validation", "--episodes", "1", "--steps", "2"]
    out, _, code, _, loaded = run(tmp_path, "league", *short, "--threads", "1")
    assert code == 0 and "torch" not in loaded and "| shipped |" in out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("missing", "arguments", "said"),
    [
        ("torch", ["train", "--out", "run"], "torch is not installed: pip install drillenv[train]"),
        (
            "stable_baselines3",
            ["train", "--out", "run"],
            "stable_baselines3 is not installed: pip install",
        ),
        ("safetensors", ["train", "--out", "run"], "safetensors is not installed: pip install drillenv[train]"),
        ("minari", ["record", "--controllers", "rules", "--dataset", "a-v0"], "pip install drillenv[datasets]"),
        ("safetensors", ["league"], "safetensors is not installed: pip install drillenv[controllers]"),
        ("safetensors", ["film", "--controllers", "rules", "--out", "a.gif"], "pip install drillenv[controllers]"),
        ("stable_baselines3", ["export", "--run", "run", "--out", "policy"], "pip install drillenv[train]"),
    ],
)
def test_what_is_not_installed_gets_one_line(missing, arguments, said, tmp_path):
    out, lines, code, _, _ = run(tmp_path, *arguments, missing=[missing])
    assert code == 2 and out == "" and len(lines) == 1 and lines[0].startswith("drillenv: ") and said in lines[0]
    assert not list(tmp_path.iterdir())
