"""What every test needs: compiled kernels that belong to the sources as they are; and which tests are asked for."""

import os
import shutil
from itertools import zip_longest
from pathlib import Path

import pytest

import drillenv

LONGEST = ("diagnosis", "training", "controllers", "atlas", "blind", "docs")
"""Folders of tests, by the time that a file of them takes."""


def pytest_configure(config) -> None:
    """Drop compiled kernels older than any kernel source: numba sees a file change, but not its imports."""
    if hasattr(config, "workerinput"):
        return
    package = Path(drillenv.__file__).parent
    changed = max((path.stat().st_mtime for path in package.rglob("*.py") if "jit" in path.read_text()), default=0.0)
    compiled = [path for ending in ("nbi", "nbc") for path in package.rglob(f"__pycache__/*.{ending}")]
    if any(path.stat().st_mtime < changed for path in compiled):
        for path in compiled:
            path.unlink(missing_ok=True)


def pytest_collection_modifyitems(items) -> None:
    """Leave out what is thorough unless it is asked for; what takes longest begins first, lest a worker ends alone.

    Files of the first folder are begun in turn with others: two workers that begin the same kernels compile them twice.
    """
    files = sorted(dict.fromkeys(item.path for item in items), key=lambda path: _rank(path.parent.name))
    first = [path for path in files if path.parent.name == LONGEST[0]]
    others = [path for path in files if path.parent.name != LONGEST[0]]
    order = [path for pair in zip_longest(first, others) for path in pair if path is not None]
    items.sort(key=lambda item: order.index(item.path))
    if os.environ.get("DRILLENV_THOROUGH") == "1":
        return
    for item in items:
        if "thorough" in item.keywords:
            item.add_marker(pytest.mark.skip(reason="takes long: set DRILLENV_THOROUGH=1"))


def _rank(folder: str) -> int:
    return LONGEST.index(folder) if folder in LONGEST else len(LONGEST)


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium that can look up no name, driven through Selenium."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    chromedriver = shutil.which("chromedriver")
    if chromium is None or chromedriver is None:
        pytest.skip("no chromium with its chromedriver on PATH (apt-get install chromium chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for argument in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--host-resolver-rules=MAP * ~NOTFOUND",
        "--window-size=1280,900",
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(executable_path=chromedriver))
    yield driver
    driver.quit()
