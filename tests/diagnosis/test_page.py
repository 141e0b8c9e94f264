"""The page of a diagnosis: what stands on it, that it is safe, and how it behaves in a real browser."""

import base64
import hashlib
import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from importlib.resources import files

import jsonschema
import numpy as np
import pytest

from drillenv.checks import InputError
from drillenv.diagnosis.page import VALUES, Trace, Wave, number, page, sentence
from drillenv.diagnosis.report import Report

HOSTILE = "<script>window.ran=1</script></title></script ><!--<script --><img src=x onerror=window.ran=2>"
HOSTILE += "{{7*7}}\u2028\"'&amp; <b>bold</b>"
RATE = 25_600.0


def blows(hertz, seconds, gain=1.0, seed=0, noise=2.0):
    """Half sines of a blow each period, in N, with the noise of a sensor."""
    time = np.arange(round(seconds * RATE)) / RATE
    since = np.mod(time, 1.0 / hertz)
    pulse = np.where(since < 1.2e-3, np.sin(np.pi * since / 1.2e-3), 0.0)
    return time, gain * 1500.0 * pulse + np.random.default_rng(seed).normal(0.0, noise, time.size)


BARE = {
    "format": "drillenv-report/1",
    "tool": {"name": "drillenv", "version": "0"},
    "inputs": {},
    "verdict": "agrees",
    "where": {"balance": None, "regimes": [], "recordings": [], "summary": "What is left is noise."},
    "findings": [],
    "parameters": {},
    "bookkeeping": [],
    "explained": None,
    "fit": {
        "unit": "N",
        "noise_floor": 1.0,
        "fitted": {"recordings": ["r1"], "before": 1.0, "after": 1.0},
        "held_out": {"recordings": [], "before": None, "after": None},
    },
    "rejected": [],
    "next": [],
    "quality": [],
    "constants": {},
    "correlations": None,
    "rest": {"summary": "Nothing is left beyond the noise."},
    "remarks": [],
    "cells": [],
}
"""All that a record has to have."""
LAW = {
    "argument": "speed into the rock, at the median depth",
    "argument_unit": "m/s",
    "unit": "N",
    "x": [0.0, 0.1, 0.2],
    "y": [0.0, 40.0, 70.0],
    "low": [0.0, 38.0, 66.0],
    "high": [0.0, 42.0, 74.0],
    "partial_residuals": {"x": [0.05, 0.15], "y": [21.0, 56.0], "std": [1.0, 1.5]},
    "nearest": {"form": "contact-rate: hunt-crossley", "y": [0.0, 36.0, 72.0]},
}


def drill(title="Sandstone, first shift", hostile=""):
    """A record and waveforms as of a drilling rig. ``hostile`` goes wherever a campaign or a lab may put words."""
    names = [f"r{i}{hostile}" for i in range(4)]
    waves = []
    for i, name in enumerate(names):
        time, measured = blows(62.0 + 9 * i, 0.5, seed=i)
        believed, found = blows(62.0 + 9 * i, 0.5, 0.9, noise=0.0)[1], blows(62.0 + 9 * i, 0.5, noise=0.0)[1]
        pushed = 400.0 * np.sin(2 * np.pi * (62.0 + 9 * i) * time)
        shaken = pushed - measured / 3.0
        waves.append(
            Wave(
                name,
                i == 3,
                time,
                (
                    Trace("force" + hostile, "N", measured, believed, found),
                    Trace("acceleration", "m/s^2", shaken, pushed - believed / 3.0, pushed - found / 3.0),
                ),
            )
        )
    cells = [
        {"recording": name, "channel": channel, "regime": regime, "samples": 2000, "mean_square": 1.0 + i * j * k * 3.7}
        for i, name in enumerate(names[:3])
        for j, channel in enumerate(("force", "acceleration"))
        for k, regime in enumerate(("no contact", "loading", "unloading"))
    ]
    record = {
        "verdict": "missing-physics",
        "where": {
            "balance": "contact",
            "regimes": ["loading", "unloading"],
            "recordings": names[1:3],
            "summary": "The rock resists a fast impact more than a slow one." + hostile,
        },
        "findings": [
            {
                "mechanism": "contact-rate",
                "equivalents": ["contact-power-law"],
                "explanation": "The rock resists a fast impact more than a slow one, and helps less on the way back.",
                "form": "measured",
                "parameters": {"chi": {"value": 0.5214, "std": 0.0312, "unit": "s/m"}},
                "law": LAW,
                "evidence": {
                    "gain": 1840.2,
                    "equation": "R = R_law (1 + chi V), V the speed into the rock, R never below 0",
                    "source": "K. H. Hunt and F. R. E. Crossley, 1975, doi:10.1115/1.3423596",
                },
            }
        ],
        "parameters": {"damping": {"value": 2790.0, "std": 20.0, "unit": "N*s/m", "nominal": 2450.0}},
        "fit": {
            "unit": "standard deviations of the sensors' noise, root mean square over force and acceleration",
            "noise_floor": 1.0,
            "fitted": {"recordings": names[:3], "before": 9.84, "after": 1.004},
            "held_out": {"recordings": names[3:], "before": 11.2, "after": 1.021},
        },
        "rejected": [
            {"mechanism": "contact-toe", "why": "explains less (812 of half a sum of squares)" + hostile},
            {"mechanism": "air-spring", "why": "gains too little (3 of half a sum of squares)"},
        ],
        "quality": ["r2, force, 0.1 s: two samples are missing" + hostile],
        "cells": cells,
        "next": ["Record at two pressures that differ by a factor of two." + hostile],
    }
    return title, {**BARE, **record}, waves


def body(title="A positioning drive"):
    """The same of one body, where the record says more and some of it otherwise."""
    time = np.arange(5000) / 250.0
    position = 0.1 * np.sin(0.9 * time)
    velocity = np.gradient(position, time)
    measured = 95.0 * np.gradient(velocity, time) + 20.0 * np.sign(velocity) + 200.0 * velocity
    measured = measured + np.random.default_rng(3).normal(0.0, 0.8, time.size)
    after = measured - np.random.default_rng(4).normal(0.0, 0.8, time.size)
    before = after - 20.0 * np.sign(velocity)
    waves = [
        Wave(
            name,
            name == "test",
            time,
            (
                Trace("force", "N", measured, before, after),
                Trace("velocity", "m/s", velocity),
                Trace("position", "m", position),
            ),
        )
        for name in ("train", "test")
    ]
    strength = {"value": 20.13, "std": 0.21, "unit": "N", "interval": [19.72, 20.54]}
    left_out = {"recordings": ["train"], "before": 19.8, "after": 0.91, "force": 61.0, "how": "each stretch in turn"}
    record = {
        "verdict": "missing-physics",
        "where": {"balance": "body", "regimes": ["forward, slow"], "recordings": ["train"], "summary": "It rubs."},
        "findings": [
            {
                "mechanism": "dry-friction",
                "equivalents": [],
                "explanation": "A dry friction holds against the motion.",
                "form": "coulomb",
                "parameters": {"fc": strength},
                "evidence": {
                    "gain": 8123.4,
                    "share_of_left_out": 0.9973,
                    "equation": "F = -fc sign(v)",
                    "source": "Coulomb",
                    "beside_a_free_lag": {"lag": {"value": 0.0002, "std": 0.0004, "unit": "s"}, "fc": strength},
                },
            }
        ],
        "parameters": {"mass": {"value": 95.11, "std": 0.12, "unit": "kg", "nominal": None}},
        "fit": {
            "unit": "N, root mean square of what is left of the force balance",
            "noise_floor": 0.8,
            "fitted": {"recordings": ["train"], "before": 19.7, "after": 0.85, "force": 61.0},
            "left_out": left_out,
            "held_out": {
                "recordings": ["test"],
                "before": 20.6,
                "after": 0.99,
                "force": 61.0,
                "how": "recordings that took no part in the fit",
                "each": {"test": {"recordings": ["test"], "before": 20.6, "after": 0.99, "force": 61.0}},
            },
        },
        "rejected": [{"mechanism": "backlash", "why": "gains too little (gain 2.1)"}],
        "quality": [],
        "constants": {
            "mass": {"value": 95.11, "std": 0.12, "unit": "kg"},
            "damping": {"value": 203.5, "std": 1.1, "unit": "N*s/m"},
        },
        "rest": {
            "summary": "0.4 N beyond the sensors' noise are left, 0.7 % of the force.",
            "excess": 0.4,
            "shapes": [{"shape": "a curve over the speed", "gain": 31.0, "share": 0.12}],
        },
        "remarks": ["Every channel is compared below 42 Hz."],
        "cells": [
            {"recording": "train", "channel": "force", "regime": regime, "samples": 900, "mean_square": value}
            for regime, value in (("forward, slow", 610.0), ("forward, fast", 420.3), ("backward, slow", 0.98))
        ],
    }
    return title, {**BARE, **record}, waves


SAMPLES = {"drill": drill, "body": body}


class Seen(HTMLParser):
    """Elements with their attributes, the text outside scripts and styles, and the scripts."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.text, self.scripts, self.inside = [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self.inside.append(tag)
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag):
        while tag in self.inside and self.inside.pop() != tag:
            pass

    def handle_data(self, data):
        if self.inside and self.inside[-1] == "script":
            self.scripts[-1] += data
        elif "style" not in self.inside:
            self.text.append(data)

    @property
    def words(self):
        return " ".join(" ".join(self.text).split())

    def ids(self):
        return [attributes["id"] for _tag, attributes in self.elements if "id" in attributes]


def waves_of(text):
    """What the page hands to its script, arrays decoded."""
    (data,) = [each for each in Seen(text).scripts if each.startswith('{"waves"')]
    waves = json.loads(data)["waves"]
    for wave in waves:
        wave["time"] = wave["begin"] + decoded(wave["time"]).astype(float)
    return waves


def decoded(text):
    return np.frombuffer(base64.b64decode(text), dtype="<f4")


@pytest.fixture(scope="module")
def drilled():
    return page(*drill())


def test_recordings_that_a_model_does_not_follow_have_no_number():
    title, record, waves = drill()
    record["fit"]["held_out"]["after"] = None
    report = Report(title, record, {}, tuple(waves))
    assert "(r3): 11.2 standard deviations of the sensors' noise before, not followed after" in report.text()
    assert '<td class="number">11.2</td><td class="number">\u2013</td>' in report.html()


@pytest.mark.parametrize(("unit", "moves"), [("m", True), ("m/s", False)])
def test_a_law_is_told_with_the_constant_beside_it(unit, moves):
    title, record, waves = drill()
    beside = {"constant": "loading_stiffness", "value": 1.52e7, "unit": "N/m"}
    record["findings"][0]["law"] = {**LAW, "argument_unit": unit, "beside": beside}
    said = page(title, record, waves)
    assert "It stands beside the loading stiffness 1.52" in said
    assert ("No channel tells where the displacement is zero" in said) == moves


def test_what_differs_between_recordings_is_told_of_each():
    title, record, waves = drill()
    record["findings"][0]["recordings"] = {HOSTILE: {"chi": 0.4}, "r02": {"chi": 0.6}}
    seen = Seen(page(title, record, waves))
    assert "Another in each recording: these are the means" in seen.words
    assert "r02: chi 0.6 s/m" in seen.words
    assert not [each for each in seen.elements if each[0] in ("img", "iframe")]


def test_everything_is_on_the_page_in_order(drilled):
    seen = Seen(drilled)
    sections = [each for tag, each in seen.elements if tag == "section"]
    assert [each["id"] for each in sections] == [
        "verdict", "map", "waveforms", "fit", "mechanisms", "constants", "rest", "rejected", "ahead", "quality",
    ]  # fmt: skip
    words = seen.words
    for expected in (
        "The model leaves out one mechanism: contact-rate; besides, one constant is off: damping.",
        "contact (the law of the rock)",
        "11.2 before, 1.02 after, noise floor 1.00 (standard deviations of the sensors' noise)",
        "R = R_law (1 + chi V)",
        "cannot tell it from contact-power-law",
        "0.460 to 0.583",  # 0.5214 -+ 1.96 * 0.0312
        "2751 to 2829",
        "+13.9 %",
        "N·s/m",
        "gains too little (3 of half a sum of squares)",
        "Record at two pressures",
        "two samples are missing",
    ):
        assert expected in words, expected


def test_one_body_has_its_own_figures():
    words = Seen(page(*body())).words
    for expected in (
        "left out in turn",
        "recordings that took no part in the fit",
        "34 % to 1.6 %",
        "19.72 to 20.54",
        "99.7 %",
        "a curve over the speed",
        "compared below 42 Hz",
        "found no fault",
        "lag of the channel",
        "203.5",
        "was to be found",
        "within its tolerance",
    ):
        assert expected in words, expected


def test_the_map_is_darker_where_the_mismatch_is_larger(drilled):
    cells = re.findall(r'<td class="\w+" style="background: rgb\((\d+), (\d+), (\d+)\)" title="([\d.]+) times', drilled)
    assert len(cells) == 18
    by_value = sorted((float(value), int(red) + int(green) + int(blue)) for red, green, blue, value in cells)
    lightness = [each[1] for each in by_value]
    assert lightness == sorted(lightness, reverse=True)
    assert lightness[0] > 700 and lightness[-1] < 250


@pytest.mark.parametrize("record", [BARE, drill()[1], body()[1]], ids=["bare", "drill", "body"])
def test_records_are_as_the_schema_has_them(record):
    schema = json.loads((files("drillenv.diagnosis") / "report.schema.json").read_text())
    jsonschema.validate(record, schema)


def test_what_is_not_in_the_record_is_not_on_the_page():
    seen = Seen(page("bare", BARE, []))
    assert seen.ids() == ["verdict", "fit", "rest", "quality"]
    assert seen.scripts == []
    gaps = {**BARE, "verdict": "unexplained", "where": {**BARE["where"], "summary": "Periodic."}}
    gaps["fit"] = {**BARE["fit"], "fitted": {"recordings": ["r1"], "before": 2.0, "after": None}}
    time, measured = blows(80.0, 0.05)
    words = Seen(page("gaps", gaps, [Wave("r1", False, time, (Trace("force", "N", measured),))])).words
    assert "no mechanism of the library accounts for it" in words
    assert "Periodic." in words
    assert "None" not in words and "nan" not in words


@pytest.mark.parametrize(
    ("record", "said"),
    [
        ({"verdict": "agrees"}, "agree with the model"),
        ({"verdict": "unexplained"}, "no mechanism of the library"),
        (
            {"verdict": "parameters", "parameters": {"damping": {"nominal": 1.0}, "mass": {"nominal": None}}},
            "No physics is missing; one constant is off: damping.",
        ),
        (
            {"verdict": "missing-physics", "findings": [{"mechanism": "a"}, {"mechanism": "b"}]},
            "The model leaves out two mechanisms: a and b.",
        ),
    ],
)
def test_the_verdict_is_one_sentence(record, said):
    record = BARE | record
    assert said in sentence(record)
    assert sentence(record).count(". ") == 0


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.0, "1"),
        (0.99962, "0.9996"),
        (12345.6, "12346"),
        (2.14e7, "2.14·10⁷"),
        (-3.1e-9, "\u22123.1·10\u207b⁹"),
        (0.0, "0"),
        (None, "\u2013"),
        (float("nan"), "\u2013"),
    ],
)
def test_numbers_are_readable(value, text):
    assert number(value) == text


def test_constants_share_their_digits_and_their_power_of_ten():
    entry = {"value": 21.437e6, "std": 0.056e6, "unit": "N/m", "nominal": 18.0e6}
    words = Seen(page("t", BARE | {"verdict": "parameters", "parameters": {"loading_stiffness": entry}}, [])).words
    assert "loading stiffness 18.000 21.437 0.056 21.327 to 21.547 10⁶ N/m +19.1 %" in words


def test_only_constants_near_to_what_is_stated_are_within_their_tolerance():
    stiffness = {"value": 80e3, "std": 200.0, "unit": "N/m", "nominal": 70e3, "nominal_std": 1000.0}
    damping = {"value": 2460.0, "std": 5.0, "unit": "N*s/m", "nominal": 2450.0, "nominal_std": 50.0}
    record = BARE | {"verdict": "missing-physics", "constants": {"stiffness": stiffness, "damping": damping}}
    words = Seen(page("t", record, [])).words
    assert "+14.3 % together with the law" in words and words.count("within its tolerance") == 1
    assert "within its tolerance" not in Seen(page("t", record | {"verdict": "unexplained"}, [])).words


def test_hostile_words_stay_words():
    title, record, waves = drill(HOSTILE, HOSTILE)
    text = page(title, record, waves)
    seen = Seen(text)
    # no element of theirs exists, and every script is the page's own, by its hash
    assert not [each for each in seen.elements if each[0] in ("img", "iframe", "object", "embed", "base")]
    assert not [each for _tag, each in seen.elements if any(name.startswith("on") for name in each)]
    assert HOSTILE.split("\u2028")[0] in seen.words
    named = re.findall(r"'sha256-([^']+)'", text)
    own = [each for each in seen.scripts if not each.startswith('{"waves"')]
    assert named == [base64.b64encode(hashlib.sha256(each.encode()).digest()).decode() for each in own]
    assert len(seen.scripts) == 3
    assert waves_of(text)[0]["name"] == waves[0].name
    # Plotly would read tags in the names of its axes
    assert "<" not in waves_of(text)[0]["traces"][0]["channel"]


def test_half_a_surrogate_can_be_written():
    page("broken \ud800 title", BARE, []).encode("utf-8")


def test_the_page_fetches_nothing(drilled):
    seen = Seen(drilled)
    for tag, attributes in seen.elements:
        assert "src" not in attributes and "srcset" not in attributes
        assert tag != "link"
        if "href" in attributes:
            assert tag == "a" and attributes["href"] == "https://doi.org/10.1115/1.3423596"
    (style,) = re.findall(r"<style>(.*?)</style>", drilled, flags=re.DOTALL)
    assert "url(" not in style and "@import" not in style
    assert "default-src 'none'" in drilled
    assert "connect-src" not in drilled


def test_peaks_are_kept_and_the_page_stays_small():
    time, measured = blows(97.0, 4.0)
    believed = blows(97.0, 4.0, noise=0.0)[1]
    at = 61_234
    measured[at] += 9000.0
    wave = Wave("r1", False, time, (Trace("force", "N", measured, believed, believed),) * 2)
    text = page("long", BARE, [Wave(f"r{i}", False, time, wave.traces) for i in range(12)])
    assert len(text.encode()) < 6.2e6
    (shown, *_others) = waves = waves_of(text)
    assert len(waves) == 12
    force = decoded(shown["traces"][0]["measured"])
    assert 500 <= force.size == shown["time"].size <= VALUES / (12 * 8)
    # the stretch holds the worst sample, unchanged, and its neighbours at the full rate
    assert force.max() == np.float32(measured[at])
    assert np.diff(shown["time"]) == pytest.approx(np.full(force.size - 1, 1 / RATE), rel=1e-3)
    assert shown["time"][0] <= time[at] <= shown["time"][-1]
    assert shown["view"][0] <= time[at] <= shown["view"][1]
    along = shown["traces"][0]["along"]
    roots = decoded(along["before"])
    assert decoded(along["time"])[roots > 20.0] == pytest.approx(time[at], abs=0.11)
    # far from it, the moving window holds nothing but noise of 2 N
    assert roots[0] == pytest.approx(2.0, rel=0.1) and roots.max() > 50.0


def test_a_short_recording_is_shown_whole_with_its_gaps():
    time, measured = blows(80.0, 0.1)
    measured[100:110] = np.nan
    (wave,) = waves_of(page("gap", BARE, [Wave("r1", True, time, (Trace("force", "N", measured, 0 * time),))]))
    force = decoded(wave["traces"][0]["measured"])
    assert wave["whole"] and wave["traces"][0]["along"] is None and wave["traces"][0]["after"] is None
    np.testing.assert_array_equal(np.isnan(force), np.isnan(measured))


def test_lengths_that_differ_are_said():
    wave = Wave("r1", False, np.arange(5.0), (Trace("force", "N", np.zeros(5), np.zeros(4)),))
    with pytest.raises(InputError, match=r"r1.*as many samples"):
        page("t", BARE, [wave])


@pytest.mark.slow
def test_what_draws_is_imported_late():
    code = (
        "import sys, drillenv.diagnosis.page\n"
        "print(sorted({'plotly', 'jinja2', 'markupsafe'} & {name.partition('.')[0] for name in sys.modules}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# in a browser


def opened(browser, folder, title, record, waves):
    """Open the page from a file; returns the requests and the console's complaints."""
    place = folder / "report.html"
    place.write_text(page(title, record, waves), encoding="utf-8")
    browser.get_log("performance"), browser.get_log("browser")
    browser.get(place.as_uri())
    return place.as_uri()


def requests(browser):
    events = [json.loads(each["message"])["message"] for each in browser.get_log("performance")]
    return [each["params"]["request"]["url"] for each in events if each["method"] == "Network.requestWillBeSent"]


def complaints(browser):
    return [each["message"] for each in browser.get_log("browser") if each["level"] in ("SEVERE", "WARNING")]


LINES = "return [...document.querySelectorAll('#waves .scatterlayer .trace')].map(e => e.getBoundingClientRect().width)"
RANGE = "return document.getElementById('waves')._fullLayout.xaxis.range.map(Number)"


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 800])
@pytest.mark.parametrize("name", SAMPLES)
def test_the_page_draws_itself(browser, tmp_path, name, width):
    browser.set_window_size(width, 900)
    _title, record, waves = SAMPLES[name]()
    address = opened(browser, tmp_path, _title, record, waves)
    assert complaints(browser) == []
    assert requests(browser) == [address]
    drawn = browser.execute_script(LINES)
    traces = waves[0].traces
    assert len(drawn) == sum(1 if trace.before is None else 5 for trace in traces)
    assert min(drawn) > 0.3 * width
    box = browser.execute_script("return document.querySelector('#waves .main-svg').getBoundingClientRect().toJSON()")
    assert 0.8 * width < box["width"] <= width and box["height"] > 300
    # no part of the page sticks out to the right
    assert browser.execute_script("return document.documentElement.scrollWidth <= window.innerWidth")
    # the lab's data stay where they are: nothing offers to upload them
    buttons = browser.execute_script("return [...document.querySelectorAll('.modebar-btn')].map(e => e.dataset.title)")
    assert "Zoom" in buttons and not [each for each in buttons if re.search("share|cloud|studio", each, re.IGNORECASE)]
    for each in browser.find_elements("css selector", "section"):
        assert each.size["height"] > 40


@pytest.mark.slow
@pytest.mark.parametrize("with_waves", [True, False])
def test_laws_are_drawn_with_their_band_residuals_and_nearest_equation(browser, tmp_path, with_waves):
    browser.set_window_size(1280, 900)
    title, record, waves = drill()
    opened(browser, tmp_path, title, record, waves if with_waves else [])
    assert complaints(browser) == []
    names = browser.execute_script("return document.getElementById('law-0').data.map(e => e.name)")
    assert names == [
        "95 % band", "recordings (partial residuals)", "nearest equation, contact-rate: hunt-crossley", "law, measured",
    ]  # fmt: skip
    box = browser.find_element("css selector", "#law-0 .main-svg")
    assert box.size["height"] > 250 and box.size["width"] > 500


@pytest.mark.slow
def test_the_choice_of_recording_and_the_zoom_work(browser, tmp_path):
    browser.set_window_size(1280, 900)
    title, record, waves = drill()
    opened(browser, tmp_path, title, record, waves)

    def peak():
        return browser.execute_script("return Math.max(...document.getElementById('waves').data[0].y)")

    data = waves_of((tmp_path / "report.html").read_text(encoding="utf-8"))
    peaks = [float(decoded(each["traces"][0]["measured"]).max()) for each in data]
    assert len(set(peaks)) == 4
    shown = browser.find_element("id", "shown")
    for i, each in enumerate(data):
        browser.find_element("css selector", f"#recording option[value='{i}']").click()
        assert peak() == pytest.approx(peaks[i])
        assert browser.execute_script(RANGE) == pytest.approx(each["view"])
        assert ("held out" in shown.text) is each["held"]
    assert not browser.find_element("id", "next").is_enabled()
    browser.find_element("id", "previous").click()
    assert peak() == pytest.approx(peaks[2])
    browser.find_element("id", "all").click()
    assert browser.execute_script(RANGE) == pytest.approx(data[2]["part"])
    # a drag over the waveform zooms, and the residual follows since they share their axis of time
    actions = pytest.importorskip("selenium.webdriver").ActionChains(browser)
    area = browser.find_element("css selector", "#waves .nsewdrag")
    actions.move_to_element_with_offset(area, -100, 0).click_and_hold().move_by_offset(150, 0).release().perform()
    low, high = browser.execute_script(RANGE)
    assert 0 < high - low < 0.4 * (data[2]["part"][1] - data[2]["part"][0])
    assert complaints(browser) == []


@pytest.mark.slow
def test_hostile_words_do_nothing(browser, tmp_path):
    title, record, waves = drill(HOSTILE, HOSTILE)
    address = opened(browser, tmp_path, title, record, waves)
    assert browser.execute_script("return window.ran === undefined")
    assert browser.find_element("css selector", "h1").text.startswith(
        "<script>window.ran=1</script></title></script ><!--<script -->"
    )
    assert browser.execute_script("return document.querySelectorAll('img').length") == 0
    assert browser.execute_script("return document.querySelectorAll('#waves a, #waves tspan[style]').length") == 0
    assert len(browser.execute_script(LINES)) == 10
    assert requests(browser) == [address]
    assert complaints(browser) == []


@pytest.mark.slow
def test_it_prints_onto_paper(browser, tmp_path):
    browser.set_window_size(1280, 900)
    opened(browser, tmp_path, *drill())
    size = (
        "const box = document.querySelector('#waves .main-svg').getBoundingClientRect();"
        "return [box.width, box.height, document.getElementById('waves')._fullLayout.font.size]"
    )
    before = browser.execute_script(size)
    browser.execute_script("window.dispatchEvent(new Event('beforeprint'))")
    width, height, font = browser.execute_script(size)
    assert width <= 700 and height < 0.7 * before[1] and font < before[2]
    browser.execute_script("window.dispatchEvent(new Event('afterprint'))")
    assert browser.execute_script(size) == pytest.approx(before)
    assert base64.b64decode(browser.print_page()).startswith(b"%PDF")
    assert complaints(browser) == []


@pytest.mark.slow
def test_the_waveforms_follow_the_window(browser, tmp_path):
    width = "return document.querySelector('#waves .main-svg').getBoundingClientRect().width"
    browser.set_window_size(1280, 900)
    opened(browser, tmp_path, *drill())
    assert browser.execute_script(width) > 1000
    browser.set_window_size(800, 900)
    wait = pytest.importorskip("selenium.webdriver.support.wait").WebDriverWait(browser, 10)
    wait.until(lambda driver: 600 < driver.execute_script(width) < 800)


def test_what_would_tell_a_finding_from_its_equivalents_is_said_of_all_of_them():
    """Advice is not given twice: there may be less of it than there are equivalents."""
    title, record, waves = body()
    finding = record["findings"][0]
    finding["equivalents"] = ["force-limit", "viscous-damping"]
    finding["evidence"]["separate"] = ["record at two speeds", "record forces of several sizes"]
    words = Seen(page(title, record, waves)).words
    told = "To tell dry-friction from force-limit and viscous-damping: record at two speeds; record forces of several"
    assert told in words
