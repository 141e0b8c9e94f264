"""What the tests of the environments share: episodes of one's own, in a file."""

import json

import pytest

RIG = {
    "shaker_mass": 265.0,
    "indenter_mass": 3.0,
    "stiffness": 68.85e3,
    "damping": 2.45e3,
    "drive_gain": 1.0,
    "pressure_gain": 1.0,
}


@pytest.fixture
def scenario(tmp_path):
    """A function that writes a scenario file: episodes as records, of which only what differs is given."""

    def write(kind, *episodes, name="own"):
        plain = {"layers": [[20.0, 24.0, None, 0]], "lag": 0.5, "blows": 3, "phase": 0.0, "rig": RIG, "effects": {}}
        record = {
            "format": "drillenv-scenario/1",
            "name": name,
            "version": 1,
            "episodes": {kind: [plain | episode for episode in episodes]},
        }
        file = tmp_path / f"{name}.json"
        file.write_text(json.dumps(record))
        return str(file)

    return write
