"""The site builds without a warning, and leads to what it promises."""

import functools
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

import drillenv
from drillenv import atlas, indentation, recordings
from drillenv.dynamics.effects import LIBRARY

ROOT = Path(__file__).parents[2]
DOORS = {
    "start/my-simulation-does-not-match.html": "My simulation does not match my rig",
    "start/train-a-controller.html": "Train a controller for a drill",
}


class Links(HTMLParser):
    """What a page links to, what it loads, and the places in it."""

    def __init__(self, page):
        super().__init__()
        self.links, self.loaded, self.places = [], [], set()
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.places.add(given.get("id"))
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        for name in ("src", "data"):
            if tag in ("img", "script", "iframe", "object", "source") and given.get(name):
                self.loaded.append(given[name])
        if tag == "link" and "stylesheet" in given.get("rel", ""):
            self.loaded.append(given["href"])


@functools.cache
def parsed(page):
    """A page, read once."""
    return Links(page)


def build(out, *options):
    """Build the site; any warning ends it."""
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-E", "-q", "-d", str(out / "trees"), *options]
    paths = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [*command, str(ROOT / "docs"), str(out / "site")], capture_output=True, text=True,
        cwd=ROOT, env={**os.environ, "PYTHONPATH": paths},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-5000:]
    return out / "site"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, its cells not run."""
    return build(tmp_path_factory.mktemp("docs"), "-D", "nb_execution_mode=off")


def missing(site, page, target):
    """Whether a link or a file that is loaded leads nowhere."""
    path, _, place = unquote(target).partition("#")
    path = path.partition("?")[0]
    there = (page.parent / path).resolve() if path else page
    if not there.exists():
        return True
    return bool(place) and there.suffix == ".html" and place not in parsed(there).places


def check_links(site):
    """Every link within the site leads somewhere, and nothing is loaded from elsewhere."""
    pages = sorted(site.rglob("*.html"))
    read = {page: parsed(page) for page in pages if "_downloads" not in page.parts and "_static" not in page.parts}
    assert len(read) > 30
    outside = re.compile(r"(?:[a-z]+:)?//|mailto:|data:", re.IGNORECASE)
    for page, found in read.items():
        name = page.relative_to(site)
        for target in found.loaded:
            assert target.startswith("data:") or not outside.match(target), f"{name} loads {target}"
            assert target.startswith("data:") or not missing(site, page, target), f"{name}: no {target}"
        for target in {each for each in found.links if not outside.match(each)}:
            assert not missing(site, page, target), f"{name} leads to {target}, which is not there"


@pytest.mark.slow
def test_every_link_and_figure_is_there_and_nothing_comes_from_elsewhere(site):
    check_links(site)


@pytest.mark.slow
def test_two_doors_on_the_home_page(site):
    home = (site / "index.html").read_text(encoding="utf-8")
    doors = re.findall(r'<a class="sd-stretched-link[^"]*" href="([^"]+)"', home)
    assert doors == list(DOORS)
    for page, title in DOORS.items():
        assert title in home and f"<h1>{title}" in (site / page).read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_page_to_play_with_is_in_it(site):
    assert 'href="play/index.html"' in (site / "index.html").read_text(encoding="utf-8")
    assert (site / "play" / "engine.js").exists()


@pytest.mark.slow
def test_each_effect_has_a_section(site):
    page = (site / "physics" / "effects.html").read_text(encoding="utf-8")
    for name, effect in LIBRARY.items():
        assert f'id="effect-{name}"' in page
        assert all(f">{each.symbol}<" in page for each in effect.parameters)


@pytest.mark.slow
@pytest.mark.parametrize("package", [drillenv, atlas, indentation, recordings], ids=lambda each: each.__name__)
def test_every_public_name_is_in_the_reference(site, package):
    text = "".join(page.read_text(encoding="utf-8") for page in (site / "reference").glob("*.html"))
    parts = {"__version__", "atlas", "controllers"} if package is drillenv else set()
    homes = (package.__name__, "drillenv")
    missing = [
        name for name in set(package.__all__) - parts if not any(f'id="{home}.{name}"' in text for home in homes)
    ]
    assert not missing


@pytest.mark.thorough
def test_every_page_runs(tmp_path):
    """From nothing: the doors' commands, and a figure of each effect."""
    site = build(tmp_path, "-D", f"nb_execution_cache_path={tmp_path / 'cache'}")
    check_links(site)
    page = (site / "physics" / "effects.html").read_text(encoding="utf-8")
    assert all(f'alt="The rig without {name} and with it"' in page for name in LIBRARY)
    door = (site / "start" / "my-simulation-does-not-match.html").read_text(encoding="utf-8")
    assert "verdict: missing-physics" in door and "contact-rate" in door
    assert "best evaluation" in (site / "start" / "train-a-controller.html").read_text(encoding="utf-8")
