"""What goes on at a frequency of its own: its columns, its frequency, and a diagnosis of it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from drillenv import Rig
from drillenv.diagnosis.condition import condition
from drillenv.diagnosis.drill_unknowns import first_states
from drillenv.diagnosis.report import diagnose
from drillenv.diagnosis.sinusoids import KINDS, frequencies, sinusoid
from drillenv.dynamics.effects import make
from tests.diagnosis.test_diagnose import campaign_with, nominal_block

VIBRATION, ROTATION = KINDS


def block_with(kind, frequency, amplitude):
    """A recording by the paper's model and a wave, its windows settled; parameters in the solver's units."""
    campaign = campaign_with()
    data = condition(campaign.recordings[0], Rig())
    block = nominal_block(campaign, data)
    term = sinusoid(kind, frequency, [data.name], 1.0)
    block = replace(block, structure=replace(block.structure, terms=(*block.structure.terms, term)))
    shared = np.array([each.value / each.scale for each in block.structure.unknowns])
    shared[-len(term.unknowns) + 1 :] = amplitude
    return block, shared, block.estimate_states(shared, first_states(data))


@pytest.mark.parametrize(("kind", "frequency"), [(VIBRATION, 31.0), (ROTATION, 1.7)])
def test_derivatives_by_frequency_and_amplitudes(kind, frequency):
    block, shared, own = block_with(kind, frequency, 3.0)
    found = block.quadratic(shared, own)
    for i in range(8, shared.size):
        step = np.zeros(shared.size)
        step[i] = 1e-3
        difference = (block.cost(shared + step, own) - block.cost(shared - step, own)) / 2e-3
        # a gradient is small beside the curvature where the fit is good
        scale = math.sqrt(found.shared[i, i])
        assert found.by_shared[i] == pytest.approx(difference, abs=0.02 * scale + 1e-3 * abs(difference)), i


def test_frequencies_are_near_enough_for_the_length_of_a_recording():
    looked = frequencies(VIBRATION, 0.8)
    assert looked[0] == VIBRATION.lowest and looked[-1] == VIBRATION.highest
    # between two of them a wave gains less than a quarter of a turn on its neighbour
    assert np.all(np.diff(looked) * 0.8 / 2.0 <= 0.25 + 1e-9)
    # a rock that turns twice a second or less only drifts in as short a recording
    assert frequencies(ROTATION, 0.8)[0] == 2.5 and frequencies(ROTATION, 0.15).size == 0


def test_another_recording_has_amplitudes_of_its_own():
    term = sinusoid(VIBRATION, 30.0, ["a", "b"], 1.0)
    values = np.arange(float(len(term.unknowns))) + 30.0
    known, own = term.of_recording("b", values)
    assert known.recordings == ("b",)
    assert own.tolist() == [30.0, 35.0, 36.0, 37.0, 38.0]
    assert term.of_recording("c", values)[1].tolist() == [30.0, 0.0, 0.0, 0.0, 0.0]


def test_what_is_stated_is_the_librarys():
    term = sinusoid(ROTATION, 1.5, ["a", "b"], 0.1)
    stated = term.stated(np.array([1.5, 0.03, 0.04, 0.05, 0.0]), np.full(5, 0.01))
    assert stated["Omega"]["value"] == pytest.approx(3.0 * math.pi)
    assert stated["eps"]["value"] == pytest.approx(0.05)
    assert stated["eps"]["unit"] == "1"


@pytest.mark.slow
def test_a_vibration_is_named_with_its_frequency(tmp_path):
    report = diagnose(campaign_with(effects=[make("external-vibration", F1=150.0, F2=2.0, f=33.3)], seed=6))
    assert report.verdict == "missing-physics"
    (finding,) = report.record["findings"]
    assert finding["mechanism"] == "external-vibration"
    f, size = finding["parameters"]["f"], finding["parameters"]["F1"]
    assert f["value"] == pytest.approx(33.3, abs=max(4.0 * f["std"], 0.02))
    assert size["value"] == pytest.approx(150.0, abs=4.0 * size["std"] + 5.0)
    held = report.record["fit"]["held_out"]
    assert held["after"] < 1.05 < held["before"]
    report.write(tmp_path)
