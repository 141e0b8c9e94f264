"""Random, fixed, rules and an oracle: how the table of the environments is made."""

import numpy as np
import pytest

from drillenv.training import headroom


def test_the_search_finds_the_best_of_a_known_landscape(monkeypatch):
    # a landscape in place of the rig: a hill whose top lies between the points of the first grid
    top = np.array([117.5, 0.4437, 1.04])

    class Made:
        def __init__(self, setting):
            self.scores = np.full(4, -float((((np.array(setting) - top) / (70.0, 0.3, 1.2)) ** 2).sum()))

    def landscape(make, *_):
        low, high = headroom.RANGES[:, 0], headroom.RANGES[:, 1]
        action = make().act(np.zeros(15), {})
        return Made(low + 0.5 * (action + 1.0) * (high - low))

    monkeypatch.setattr(headroom, "rollout", landscape)
    found = np.array(headroom.best_fixed("DrillLayers", "validation"))
    # half of the last spacing in each control: 10 Hz, 0.05 V and 0.2 bar halved three times
    assert np.all(np.abs(found - top) <= (1.25, 0.0063, 0.025))


def test_the_interval_is_of_pairs():
    rng = np.random.default_rng(0)
    oracle = rng.uniform(1.0, 2.0, 50)
    found = headroom.interval(0.8 * oracle, oracle)
    assert found["share"] == pytest.approx(0.8)
    np.testing.assert_allclose(found["share_interval"], [0.8, 0.8])
    low, high = found["score_interval"]
    assert low < found["score"] < high
    assert high - low == pytest.approx(2 * 1.96 * 0.8 * oracle.std() / np.sqrt(50), rel=0.1)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--environment", "Dril"], "environment is 'Dril': give one of Drill, DrillLayers, DrillHidden"),
        (["--scenario", "nowhere"], "scenario is 'nowhere': give one of train"),
        (["--json", "/nowhere/at/all.json"], "cannot write"),
        (["--nonsense"], "unrecognized arguments"),
    ],
)
def test_bad_input_gets_one_line(arguments, said, capsys):
    assert headroom.main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("error: ") and err.count("\n") == 1 and said in err
