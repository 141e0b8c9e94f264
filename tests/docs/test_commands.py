"""Every command line in the documentation is one that the command line takes; the cheap ones run."""

import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from drillenv import cli

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def commands():
    """(page, command) of every line of a block that begins with drillenv or python -m."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for line in re.findall(r"^(?: {4})?((?:drillenv|python -m) .*)$", text, flags=re.MULTILINE):
            if line.startswith(("drillenv with", "drillenv: ")):  # prose that wraps, a message
                continue
            yield str(page.relative_to(ROOT)), " ".join(line.split())


LINES = sorted(set(commands()))
OURS = [each for each in LINES if each[1].startswith("drillenv ")]
MODULES = [each for each in LINES if each[1].startswith("python -m ")]
CHEAP = sorted({line for _, line in OURS if re.match(r"drillenv (motion|simulate) --rock \d .*", line)})


def test_there_are_commands():
    assert len(OURS) > 40 and len(MODULES) > 3 and len(CHEAP) > 1


@pytest.mark.parametrize(("page", "line"), OURS)
def test_the_command_line_takes_it(page, line):
    words = shlex.split(line, comments=True)[1:]
    try:
        assert cli._parser().parse_args(words).run
    except SystemExit as end:  # an option that prints something and ends
        assert end.code in (0, None) and words[0].startswith("--")


@pytest.mark.slow
@pytest.mark.parametrize(("page", "line"), MODULES)
def test_the_module_is_there_and_has_the_options(page, line):
    words = shlex.split(line, comments=True)
    module = words[2]
    assert importlib.util.find_spec(module), f"{page}: no module {module}"
    shown = subprocess.run([sys.executable, "-m", module, "--help"], cwd=ROOT, capture_output=True, text=True)
    assert shown.returncode == 0, shown.stderr
    for word in words[3:]:
        assert not word.startswith("--") or re.search(rf"{word}\b", shown.stdout), f"{page}: {module} has no {word}"


@pytest.mark.slow
@pytest.mark.parametrize("line", CHEAP)
def test_the_cheap_ones_run(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(shlex.split(line, comments=True)[1:]) == 0
