"""Indentation tests: made curves give back their laws, errors are one line, and the rock goes where --rock goes."""

import json

import numpy as np
import pytest

from drillenv import cli, fit_indentation, read_rock
from drillenv.checks import InputError
from drillenv.indentation import Curve, read_curve
from drillenv.rocks import rock
from tests.indentation.made import Made, drawn

SETTING = ["--frequency", "120", "--amplitude", "0.45", "--pressure", "1.0"]
# Table 2.2 in kN/mm, typed in again: k_l and k_u of ten indentations.
TABLE = {
    1: (
        "8.17 11.32 11.29 11.62 11.34 11.98 11.77 11.73 12.43 12.45",
        "13.26 13.52 13.42 13.39 13.71 13.89 13.82 14.06 13.60 13.12",
    ),
    2: (
        "6.70 12.03 11.68 11.68 11.92 12.10 11.71 11.38 11.98 11.99",
        "14.28 14.27 13.68 14.00 13.99 14.17 13.98 13.80 13.83 13.51",
    ),
    3: (
        "6.47 11.01 11.26 11.42 12.15 11.55 12.11 11.45 11.67 11.69",
        "13.23 13.43 13.11 12.90 13.43 13.70 13.23 13.03 13.95 13.66",
    ),
    4: (
        "5.42 17.14 15.95 18.04 19.07 18.44 21.37 22.03 20.67 21.55",
        "21.57 21.75 23.55 22.37 25.65 23.95 24.24 24.25 26.35 25.36",
    ),
    5: (
        "3.03 16.81 26.18 29.14 30.77 30.96 31.69 34.11 32.98 35.88",
        "37.88 37.80 39.66 38.10 40.61 40.00 43.97 37.78 40.25 41.23",
    ),
    6: (
        "5.16 19.12 19.67 18.79 21.59 21.95 22.32 21.94 22.80 21.58",
        "25.87 22.96 31.98 28.92 26.16 27.38 28.78 29.67 24.77 26.08",
    ),
}


def write(
    path, time, displacement, force, header="time (s),displacement (mm),force (kN)", delimiter=",", scale=(1e3, 1e-3)
):
    rows = np.column_stack([time, scale[0] * displacement, scale[1] * force])
    lines = [delimiter.join(f"{value:.9g}" for value in row) for row in rows]
    text = "\n".join([header, *lines]) + "\n"
    path.write_text(text.replace(".", ",") if delimiter == ";" else text, encoding="utf-8")
    return path


@pytest.fixture
def simple():
    """Two indentations, made."""
    made = Made([20e6, 20e6], [25e6, 25e6], compliance=5e-9, rate=4.0)
    return made, made.make(np.random.default_rng(3))[:3]


def refusal(*arguments, **options):
    with pytest.raises(InputError) as caught:
        fit_indentation(*arguments, **options)
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


def test_true_laws_lie_in_their_intervals():
    hits = {symbol: [] for symbol in ("k_l", "k_u", "n_l", "n_u")}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        made = drawn(rng, most=3)
        time, displacement, force, _ = made.make(rng)
        test = fit_indentation(Curve(time, displacement, force), made.compliance)
        assert len(test.measured) == len(made.loading)
        for j, one in enumerate(test.measured):
            truth = made.truth(j)
            for way, branch in zip("lu", (one.loading, one.unloading), strict=True):
                for symbol, found in (("k", branch.stiffness), ("n", branch.exponent)):
                    hits[f"{symbol}_{way}"].append(found.low <= truth[f"{symbol}_{way}"] <= found.high)
    for symbol, inside in hits.items():
        assert 0.85 <= np.mean(inside) <= 1.0, symbol


@pytest.fixture(scope="module")
def six():
    """Of each case the stiffnesses it was made with, and the test that was fitted to it."""
    found = {}
    for case, rows in TABLE.items():
        k_l, k_u = ([1e6 * float(each) for each in row.split()] for row in rows)
        made = Made(k_l, k_u, rate=2.0, standing=60.0, force_noise=(3.0, 0, 0), displacement_noise=(0.05e-6, 0, 0))
        time, displacement, force, _ = made.make(np.random.default_rng(case))
        found[case] = {"loading": k_l, "unloading": k_u}, fit_indentation(Curve(time, displacement, force), 0.0)
    return found


@pytest.mark.parametrize("case", sorted(TABLE))
def test_the_six_rocks_come_back(six, case):
    truth, test = six[case]
    early = test.phases.early
    assert 1 <= early <= 8
    assert test.measured[0].phase == "impact"
    for symbol, way in (("k_l", "loading"), ("k_u", "unloading")):
        stable = test.stable[symbol].mean
        assert stable.low <= np.mean(truth[way][early:]) <= stable.high


def test_each_indentation_and_factor_of_the_six_rocks_comes_back(six):
    """Together, since the indentations of a curve share the error of its drift."""
    stiffness, factors = [], []
    for truth, test in six.values():
        early = test.phases.early
        for way in ("loading", "unloading"):
            mean = np.mean(truth[way][early:])
            for j, (one, true) in enumerate(zip(test.measured, truth[way], strict=True)):
                found, factor = getattr(one, way).stiffness, getattr(one, f"{way}_factor")
                stiffness.append(found.low <= true <= found.high)
                if j < early:
                    factors.append(factor.low <= true / mean <= factor.high)
    assert np.mean(stiffness) >= 0.85
    assert np.mean(factors) >= 0.85


def test_drift_compliance_and_creep_are_told():
    made = Made(
        [20e6], [25e6], hold=40.0, creep=4e-6, compliance=1e-8, force_drift=0.02, zero=30.0, displacement_drift=1e-8
    )
    time, displacement, force, _ = made.make(np.random.default_rng(1))
    test = fit_indentation(Curve(time, displacement, force), 1e-8)
    (one,) = test.measured
    assert one.hold == pytest.approx(40.0, abs=5.0)
    assert one.creep.low <= 4e-6 <= one.creep.high
    assert one.creep.std < 1.5e-6
    assert test.zeros[0].rate == pytest.approx(0.02, abs=0.005)
    assert test.drift.rate == pytest.approx(1e-8, abs=4 * test.drift.std)
    in_series = fit_indentation(Curve(time, displacement, force))
    assert in_series.measured[0].loading.stiffness.value == pytest.approx(1 / (1 / 20e6 + 1e-8), rel=0.01)
    assert any("in series" in warning for warning in in_series.warnings)


def test_units_and_decimal_commas_are_the_same_curve(tmp_path, simple):
    _, samples = simple
    one = read_curve(write(tmp_path / "a.csv", *samples))
    headers = "Time;Extension;Load\n(s);(um);(N)"
    other = read_curve(write(tmp_path / "b.csv", *samples, header=headers, delimiter=";", scale=(1e6, 1.0)))
    np.testing.assert_allclose(one.displacement, other.displacement, rtol=1e-7)
    np.testing.assert_allclose(one.force, other.force, rtol=1e-7, atol=1e-6)
    turned = read_curve(write(tmp_path / "c.csv", samples[0], -samples[1], -samples[2]))
    np.testing.assert_allclose(one.force, turned.force)
    assert len(turned.notes) == 2


def test_numbered_indentations(tmp_path):
    made = Made([20e6, 21e6], [25e6, 26e6], rate=4.0)
    time, displacement, force, number = made.make(np.random.default_rng(3))
    test = fit_indentation(Curve(time, displacement, force, number), 0.0)
    assert [one.phase for one in test.measured] == ["stable", "stable"]
    assert test.measured[1].loading.stiffness.value == pytest.approx(21e6, rel=0.02)


@pytest.mark.parametrize(
    ("cut", "message"),
    [
        (lambda t, x, f: (t[: f.argmax() + 5], x[: f.argmax() + 5], f[: f.argmax() + 5]), "no unloading branch"),
        (lambda t, x, f: (t[f.argmax() :], x[f.argmax() :], f[f.argmax() :]), "no loading branch"),
        (lambda t, x, f: (t[f > 60], x[f > 60], f[f > 60]), "free of contact"),
        (lambda t, x, f: (t[::400], x[::400], f[::400]), "samples"),
        (lambda t, x, f: (t, x * 1e-3, f), "displacement in mm, in place of um"),
        (lambda t, x, f: (t, x * 1e3, f), "N/m, outside"),
        (lambda t, x, f: (t[::-1], x, f), "does not grow"),
        (lambda t, x, f: (t, x, np.zeros_like(f)), "never changes"),
    ],
)
def test_a_bad_curve_is_one_line(tmp_path, cut, message):
    samples = Made([20e6], [25e6], rate=4.0).make(np.random.default_rng(3))[:3]
    path = write(tmp_path / "a.csv", *cut(*samples), header="time (s),displacement (um),force (N)", scale=(1e6, 1.0))
    assert message in refusal(path, 0.0)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("time (s),displacement,force (kN)", "has no unit"),
        ("time (s),displacement (inch),force (kN)", "'inch'"),
        ("a,b,c", "no header line"),
        ("time (s),displacement (mm),extension (mm)", "no header line"),
    ],
)
def test_a_bad_header_is_one_line(tmp_path, simple, header, message):
    assert message in refusal(write(tmp_path / "a.csv", *simple[1], header=header))


def test_a_compliance_larger_than_the_whole_is_refused(simple):
    assert "more" not in refusal(Curve(*simple[1]), compliance=1e-7)
    assert "was it in mm/kN" in refusal(Curve(*simple[1]), compliance=0.005)
    assert "cannot be read" in refusal("missing.csv")


def test_rock_file_goes_where_a_rock_goes(tmp_path, monkeypatch, capsys, simple):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "granite.csv", *simple[1])
    for picture in ("fig.png", "fig.svg"):
        given = ["indentation", "granite.csv", "--compliance", "5e-9", "--out", "rock.json", "--plot", picture]
        assert cli.main(given) == 0
        assert (tmp_path / picture).stat().st_size > 5000
    assert "wrote rock.json" in capsys.readouterr().out
    record = json.loads((tmp_path / "rock.json").read_text(encoding="utf-8"))
    found = read_rock("rock.json")
    test = fit_indentation("granite.csv", 5e-9)
    assert found == test.rock() == rock("rock.json")
    assert found.name == "granite"
    assert found.loading_stiffness == record["loading_stiffness"] == pytest.approx(20e6, rel=0.02)
    assert found.indentations.phase("stable")[0] == found.indentations.loading
    assert len(record["source"]["sha256"]) == 64
    for command in (["motion"], ["simulate", "--seconds", "0.05"]):
        assert cli.main([*command, *SETTING, "--rock", "rock.json", "--json"]) == 0
        told = json.loads(capsys.readouterr().out)["rock"]
        assert told["loading_stiffness"] == found.loading_stiffness
        assert told["name"] == "granite"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not JSON"),
        ("[]", "format is []"),
        ('{"format": "drillenv-model/1"}', "format is 'drillenv-model/1'"),
        ('{"format": "drillenv-rock/1"}', "loading_stiffness is missing"),
        ('{"format": "drillenv-rock/1", "loading_stiffness": 21.4, "unloading_stiffness": 25e6}', "was it in kN/mm"),
        ('{"format": "drillenv-rock/1", "loading_stiffness": 3e7, "unloading_stiffness": 2e7}', "give energy away"),
        ('{"format": "drillenv-rock/1", "colour": 1}', "unknown key 'colour'"),
    ],
)
def test_a_bad_rock_file_is_one_line(tmp_path, capsys, text, message):
    path = tmp_path / "rock.json"
    path.write_text(text, encoding="utf-8")
    assert cli.main(["motion", *SETTING, "--rock", str(path)]) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert len(printed.splitlines()) == 1
