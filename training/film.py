"""An episode as a film: one controller or several beside each other, through a change of rock.

    python -m drillenv.training.film --controllers rules learned --out FILM.gif [--episode 3] [--first 20] [--frames 48]

Each frame is a control interval of 0.25 s as ``render()`` draws it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from drillenv import controllers
from drillenv.checks import InputError, choice, count
from drillenv.cli import Parser
from drillenv.controllers import Controller, OnPlant
from drillenv.env.plant import INTERVAL
from drillenv.env.registration import STEPS
from drillenv.env.scalar import DrillEnv
from drillenv.files import check_writable, whole

BAND = 34
"""Height in pixels of the line above a picture."""
COLOURS = 64
"""Of a film."""
GROUND, INK = "#0f151c", "#e8edf2"


def pictures(
    controller: Controller, scenario: str, episode: int, first: int, frames: int, width: int
) -> list[Image.Image]:
    """What ``render()`` draws of an episode, from step ``first`` on.

    Args:
        controller: What drills.
        scenario, episode: What is drilled.
        first: Steps drilled before the first picture.
        frames: Number of pictures.
        width: Of a picture in pixels.
    """
    env = DrillEnv(kind="layers", scenario=scenario, render_mode="rgb_array")
    observation, info = env.reset(seed=episode, options={"episode": episode})
    if isinstance(controller, OnPlant):
        controller.attach(env.get_state)
    controller.reset(seed=episode)
    env.render()  # the clock of the picture starts with the episode
    made = []
    for step in range(first + frames):
        action = controller.act(observation, info if controller.sees_truth else {})
        observation, _, _, _, info = env.step(action)
        frame = env.render()
        if step >= first and isinstance(frame, np.ndarray):
            picture = Image.fromarray(frame)
            made.append(
                picture.resize((width, round(width * picture.height / picture.width)), Image.Resampling.LANCZOS)
            )
    env.close()
    return made


def beside(columns: Sequence[Sequence[Image.Image]], names: Sequence[str]) -> list[Image.Image]:
    """The pictures of several controllers in one, each below its name."""
    font = ImageFont.load_default(20)
    joined = []
    for row in zip(*columns, strict=True):
        width = sum(picture.width for picture in row)
        page = Image.new("RGB", (width, BAND + row[0].height), GROUND)
        draw, left = ImageDraw.Draw(page), 0
        for name, picture in zip(names, row, strict=True):
            draw.text((left + 12, 5), name, fill=INK, font=font)
            page.paste(picture, (left, BAND))
            left += picture.width
        joined.append(page)
    return joined


def write_film(file: str, pages: Sequence[Image.Image], speed: float = 1.0) -> None:
    """Write a GIF that repeats, at ``speed`` times the speed of the rig."""
    # one palette for all frames, so that what stays the same is not stored again
    sample = Image.new("RGB", (pages[0].width, 3 * pages[0].height))
    for i, k in enumerate((0, len(pages) // 2, len(pages) - 1)):
        sample.paste(pages[k], (0, i * pages[0].height))
    palette = sample.quantize(COLOURS, Image.Quantize.MEDIANCUT)
    frames = [page.quantize(palette=palette, dither=Image.Dither.NONE) for page in pages]
    with whole(file) as part:
        frames[0].save(
            part,
            format="GIF",
            save_all=True,
            append_images=frames[1:],
            duration=round(1e3 * INTERVAL / speed),
            loop=0,
            optimize=True,
        )


def parser() -> Parser:
    """The options."""
    made = Parser(prog="python -m drillenv.training.film", description=(__doc__ or "").split("\n")[0])
    made.add_argument("--controllers", nargs="+", required=True, help=f"of {', '.join(controllers.NAMES)}")
    made.add_argument("--out", required=True, help="a file that ends in .gif")
    made.add_argument("--scenario", default="test", help="a frozen set, or a file of one (default test)")
    made.add_argument("--episode", type=int, default=0, help="of the scenario (default 0)")
    made.add_argument("--first", type=int, default=0, help="steps before the first picture (default 0)")
    made.add_argument("--frames", type=int, default=48, help="pictures, one every 0.25 s (default 48)")
    made.add_argument("--width", type=int, default=640, help="of each controller's picture in pixels (default 640)")
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line. Returns the exit code: 0, 2 on bad input."""
    try:
        given = parser().parse_args(arguments)
        if not given.out.lower().endswith(".gif"):
            raise InputError(f"--out is {given.out!r}: give a file that ends in .gif")
        names = [choice("controller", name, tuple(controllers.NAMES)) for name in given.controllers]
        frames = count("frames", given.frames, 1, STEPS["DrillLayers"])
        first = count("first", given.first, 0, STEPS["DrillLayers"] - frames)
        width = count("width", given.width, 64, 1280)
        check_writable(given.out)
        take = partial(pictures, scenario=given.scenario, episode=given.episode, first=first, frames=frames)
        write_film(given.out, beside([take(controllers.make(name), width=width) for name in names], names))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
