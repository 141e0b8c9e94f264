"""What ``import drillenv`` costs, and what it offers."""

import json
import subprocess
import sys

import pytest

import drillenv
from drillenv.checks import InputError

HEAVY = ("numba", "scipy", "torch", "matplotlib", "xarray", "h5netcdf", "tqdm", "ray", "pandas", "plotly", "jinja2")


def fresh(code, folder):
    """What a new interpreter prints as JSON, run outside the checkout."""
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return json.loads(done.stdout)


IMPORT = """
import json, sys, time
begin = time.perf_counter()
import drillenv
drillenv.Setting, drillenv.Rig, drillenv.ROCKS
print(json.dumps([time.perf_counter() - begin, sorted({name.partition(".")[0] for name in sys.modules})]))
"""


def test_import_is_light(tmp_path):
    fresh(IMPORT, tmp_path)  # a first time, to write the bytecode
    runs = [fresh(IMPORT, tmp_path) for _ in range(3)]
    assert min(seconds for seconds, _modules in runs) < 1.0
    assert not set(HEAVY) & set(runs[0][1])


@pytest.mark.slow
def test_command_line_is_light(tmp_path):
    code = IMPORT.replace("import drillenv\n", "import drillenv, drillenv.cli\n")
    fresh(code, tmp_path)  # the same
    runs = [fresh(code, tmp_path) for _ in range(3)]
    assert min(seconds for seconds, _modules in runs) < 1.0
    assert not set(HEAVY) & set(runs[0][1])


@pytest.mark.parametrize("name", sorted(drillenv.__all__))
def test_every_name_is_there(name):
    assert getattr(drillenv, name) is getattr(drillenv, name)
    assert name in dir(drillenv)


def test_names_are_those_of_their_modules():
    from drillenv.dynamics.motion import motion
    from drillenv.dynamics.simulate import simulate

    assert drillenv.simulate is simulate
    assert drillenv.motion is motion
    assert drillenv.InputError is InputError
    assert drillenv.rock(4) is drillenv.ROCKS[4]


@pytest.mark.slow
@pytest.mark.parametrize(
    "code",
    [
        "drillenv.atlas.sweep, drillenv.sweep, drillenv.atlas.atlas",
        "drillenv.sweep, drillenv.atlas.sweep",
        "drillenv.load_atlas, drillenv.atlas.load_atlas",
    ],
)
def test_the_room_and_what_is_in_it_do_not_depend_on_who_was_first(code, tmp_path):
    assert fresh(
        f"import drillenv\n{code}\nprint(callable(drillenv.sweep) and not callable(drillenv.atlas) and 1)", tmp_path
    )


def test_no_such_name():
    with pytest.raises(AttributeError, match="no attribute 'drill'"):
        _ = drillenv.drill
