"""The model file: what a diagnosis writes is what the engines get, and which effects are for what."""

import json

import pytest

from drillenv.checks import InputError
from drillenv.corrected import Corrected, effect_record, model_from_record, read_model, write_model
from drillenv.dynamics.effects import make
from drillenv.rig import Rig
from drillenv.rocks import Rock

RATE, OFFSET = make("contact-rate", chi=0.52), make("sensor-offset")


def test_written_and_read_back(tmp_path):
    model = Corrected(Rig(damping=2790.0), Rock(21.9e6, 25.1e6, "corrected"), (RATE, OFFSET))
    write_model(tmp_path / "model.json", model)
    assert read_model(tmp_path / "model.json") == model
    assert [path.name for path in tmp_path.iterdir()] == ["model.json"]
    record = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    assert record["effects"][0] == effect_record(RATE) == {"name": "contact-rate", "parameters": RATE.given}


def test_effects_on_sensors_are_told_from_those_on_the_motion():
    model = Corrected(effects=(OFFSET, RATE, make("mains-hum", b_f=5.0)))
    assert model.on_motion == (RATE,)
    assert [each.effect.name for each in model.on_sensors] == ["sensor-offset", "mains-hum"]


@pytest.mark.parametrize("name", ["dry-friction", "viscous-damping"])
def test_an_effect_of_a_one_body_rig_is_refused(name):
    with pytest.raises(InputError, match=f"{name}, which is one of a one-body rig"):
        _ = Corrected(effects=(RATE, make(name))).on_motion


def test_a_model_of_another_rig_is_refused():
    with pytest.raises(InputError, match="rig is 'one-body': give a model of the percussive-drill"):
        model_from_record({"format": "drillenv-model/1", "rig": "one-body", "constants": {}, "effects": []})


def test_an_effect_of_both_rigs_is_taken():
    play = make("backlash", g=1e-4)
    assert Corrected(effects=(play,)).on_motion == (play,)
