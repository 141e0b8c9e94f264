"""The lines of Python in the documentation run, and its tables are those that were measured."""

import json
import os
import re
from pathlib import Path
from unittest.mock import patch

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_in_the_pages_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    if any("import minari" in block for block in blocks):
        pytest.importorskip("minari")
    with patch.dict(os.environ):
        for block in blocks:
            exec(compile(block, str(page), "exec"), {"__name__": "__main__"})


def test_headroom_in_the_page_is_what_was_measured():
    from drillenv.training.headroom import table

    page = (ROOT / "docs" / "environment" / "README.md").read_text(encoding="utf-8")
    for name in ("headroom", "headroom-drill"):
        record = json.loads((ROOT / "docs" / "environment" / f"{name}.json").read_text(encoding="utf-8"))
        assert table(record) in page
        assert record["rows"]["best fixed"]["share"] <= 0.75
        assert record["rows"]["random"]["share"] < 0.5 * record["rows"]["best fixed"]["share"]
