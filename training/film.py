"""An episode as a film: one controller or several beside each other, through a change of rock.

Each frame is a control interval of 0.25 s as ``render()`` draws it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from drillenv.controllers import Controller, OnPlant, sees_truth
from drillenv.env.plant import INTERVAL
from drillenv.env.scalar import DrillEnv
from drillenv.files import whole
from drillenv.training.rollout import action_of

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
        action = action_of(controller, observation, info if sees_truth(controller) else {})
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
