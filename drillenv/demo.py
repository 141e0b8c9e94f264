"""What this package does, shown in three minutes: ``drillenv demo``.

Three parts, each by the command that a user would type, side by side on the cores there are: the published motions
(``paper``), an episode drilled by rules and by the shipped policy (``film``), and a campaign made with an effect that
the model leaves out (``simulate --campaign``) and diagnosed (``diagnose``). A page, ``index.html``, leads to all three.
"""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drillenv.checks import InputError
from drillenv.files import made_folder, whole

EFFECT, ROCK = "contact-rate chi=0.45", 4
"""What the campaign conceals, and on which rock of Table 2.2."""
EPISODE, FIRST, FRAMES, WIDTH = 3, 20, 24, 480
"""What is filmed: the part of an episode of "test" with a change of rock."""
PAGE = "demo.html"
LIBRARY_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True, slots=True)
class Part:
    """A part of the demonstration."""

    name: str
    commands: tuple[tuple[str, ...], ...]
    """Arguments of ``drillenv``, one after the other; paths are relative to the folder of the demonstration."""

    @property
    def lines(self) -> list[str]:
        """The commands as one would type them."""
        return [shlex.join(("drillenv", *command)) for command in self.commands]


PARTS = (
    Part("paper", (("paper", "--out", "paper"),)),
    Part(
        "diagnosis",
        (
            (*f"simulate --campaign campaign --rock {ROCK} --seconds 0.4 --seed 4 --effect".split(), *EFFECT.split()),
            ("diagnose", "campaign", "--out", "report", "--jobs", "1"),
        ),
    ),
    Part(
        "film",
        (
            (
                *("film", "--controllers", "rules", "shipped", "--out", "film.gif", "--episode", str(EPISODE)),
                *("--first", str(FIRST), "--frames", str(FRAMES), "--width", str(WIDTH)),
            ),
        ),
    ),
)


def demonstrate(out: str | os.PathLike[str], say: Callable[[str], object]) -> Path:
    """Run all parts and write the page.

    Args:
        out: The folder, made if it is not there.
        say: Told what is being done and what came of it.

    Returns:
        The page.

    Raises:
        InputError: the folder cannot be made, or a part failed.
    """
    folder = made_folder(out)
    say("The published motions, a diagnosis and a film, side by side; the first run compiles for about a minute.")
    with ThreadPoolExecutor(max_workers=2) as pool:
        list(pool.map(lambda part: _run(part, folder, say), PARTS))
    page = folder / "index.html"
    with whole(page) as part:
        part.write_text(_page(folder), encoding="utf-8")
    say(f"Open {page}")
    return page


def _run(part: Part, folder: Path, say: Callable[[str], object]) -> None:
    """The commands of a part; what they print goes into a file of the part's name.

    Raises:
        InputError: a command failed.
    """
    environment = os.environ | dict.fromkeys(LIBRARY_THREADS, "1")
    entry = "import sys; from drillenv.cli import main; sys.exit(main())"
    log = folder / f"{part.name}.txt"
    with log.open("w", encoding="utf-8") as printed:
        for command, line in zip(part.commands, part.lines, strict=True):
            say(f"  {line}")
            done = subprocess.run(
                [sys.executable, "-c", entry, *command],
                cwd=folder,
                env=environment,
                stdout=printed,
                stderr=subprocess.STDOUT,
                check=False,
            )
            if done.returncode:
                raise InputError(f"{line} ended with the code {done.returncode}: see {log}")
    say(f"  {part.name} is done: {_outcome(part.name, folder)}")


def _outcome(name: str, folder: Path) -> str:
    """What a part found, in one sentence."""
    if name == "paper":
        rows = json.loads((folder / "paper" / "published.json").read_text(encoding="utf-8"))
        return f"{sum(bool(row['agrees']) for row in rows)} of {len(rows)} published rows agree."
    if name == "diagnosis":
        report = _report(folder)
        named = ", ".join(finding["mechanism"] for finding in report["findings"]) or "nothing"
        return f"{EFFECT.split()[0]} was concealed, {named} was named."
    return "one change of rock, by the rules and by the shipped policy."


def _report(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "report" / "report.json").read_text(encoding="utf-8"))


def _page(folder: Path) -> str:
    """The page that leads to all parts."""
    from jinja2 import Environment, PackageLoader, select_autoescape

    templates = Environment(loader=PackageLoader("drillenv", "."), autoescape=select_autoescape(["html"]))
    rows = json.loads((folder / "paper" / "published.json").read_text(encoding="utf-8"))
    report = _report(folder)
    return templates.get_template(PAGE).render(
        agreeing=sum(bool(row["agrees"]) for row in rows),
        rows=len(rows),
        figures=sorted(path.name for path in (folder / "paper").glob("figure-*.png")),
        effect=EFFECT,
        rock=ROCK,
        findings=report["findings"],
        explained=report.get("explained"),
        lines={part.name: part.lines for part in PARTS},
    )
