"""Reading curves, and each way in which one cannot be used, in one line."""

import numpy as np
import pytest

from drillenv import fit_indentation
from drillenv.checks import InputError
from drillenv.indentation import Curve, read_curve
from tests.indentation.made import Made, write


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
    assert "give that of the machine alone" in refusal(Curve(*simple[1]), compliance=1e-7)
    assert "was it in mm/kN" in refusal(Curve(*simple[1]), compliance=0.005)
    assert "cannot be read" in refusal("missing.csv")
