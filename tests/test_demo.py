"""The demonstration: all parts run, and the page leads to what they made."""

import re

import pytest

from drillenv import demo
from drillenv.checks import InputError
from drillenv.demo import PARTS, Part, demonstrate


@pytest.mark.slow
def test_the_page_leads_to_everything(tmp_path):
    said = []
    page = demonstrate(tmp_path / "demo", said.append)
    text = page.read_text(encoding="utf-8")
    links = re.findall(r'(?:href|src)="([^"]+)"', text)
    assert {"film.gif", "report/report.html", "report/model.json", "paper/published.json"} <= set(links)
    for link in links:
        assert (page.parent / link).is_file(), link
    assert "<strong>contact-rate</strong>" in text
    for part in PARTS:
        assert any(line.startswith(f"  {part.name} is done") for line in said)
        for line in part.lines:
            assert line in text


@pytest.mark.slow
def test_a_part_that_fails_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(demo, "PARTS", (Part("film", (("film", "--controllers", "nobody", "--out", "film.gif"),)),))
    with pytest.raises(InputError, match=r"drillenv film --controllers nobody .* ended with the code 2: see") as caught:
        demonstrate(tmp_path, lambda _text: None)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "index.html").exists()
    assert "nobody" in (tmp_path / "film.txt").read_text(encoding="utf-8")


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot make the folder"):
        demonstrate(tmp_path / "file" / "demo", lambda _text: None)
