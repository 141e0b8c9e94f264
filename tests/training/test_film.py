"""Episodes as films."""

import numpy as np
import pytest
from PIL import Image

from drillenv import cli, controllers
from drillenv.training.film import beside, pictures


def main(arguments):
    return cli.main(["film", *arguments])


@pytest.mark.slow
def test_a_film_shows_what_the_controllers_did_beside_each_other(tmp_path, capsys):
    file = tmp_path / "film.gif"
    asked = ["--controllers", "rules", "fixed", "--first", "1", "--frames", "2", "--width", "320"]
    assert main([*asked, "--scenario", "validation", "--out", str(file)]) == 0
    assert capsys.readouterr() == ("", "")
    with Image.open(file) as film:
        assert film.format == "GIF" and film.size == (640, 214) and film.n_frames == 2
        assert film.info["duration"] == 250 and film.info["loop"] == 0
        shown = []
        for i in range(2):
            film.seek(i)
            shown.append(np.asarray(film.convert("RGB")).astype(int))
    # the picture below its name is that of the environment, but for the fewer colours
    frames = pictures(controllers.make("rules"), "validation", 0, 1, 2, 320)
    for one, other in zip(shown, frames, strict=True):
        assert np.abs(one[34:, :320] - np.asarray(other)).mean() < 6.0
    assert np.abs(shown[0] - shown[1]).max() > 50


def test_pages_hold_all_pictures_under_their_names():
    red, blue = (Image.new("RGB", (40, 20), colour) for colour in ("#ff0000", "#0000ff"))
    (page,) = beside([[red], [blue]], ["a", "b"])
    assert page.size == (80, 54)
    assert page.getpixel((10, 40)) == (255, 0, 0) and page.getpixel((70, 40)) == (0, 0, 255)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--controllers", "ruels", "--out", "a.gif"], "controller is 'ruels'"),
        (["--controllers", "rules", "--out", "a.mp4"], "--out is 'a.mp4': give a file that ends in .gif"),
        (["--controllers", "rules", "--out", "a.gif", "--frames", "0"], "frames is 0, outside 1 to 240"),
        (["--controllers", "rules", "--out", "a.gif", "--first", "230"], "first is 230, outside 0 to 192"),
        (["--controllers", "rules", "--out", "/nowhere/at/all/a.gif"], "cannot write"),
        (["--controllers", "fixed", "--out", "a.gif", "--episode", "60"], "episode is 60, outside 0 to 59"),
    ],
)
def test_bad_input_gets_one_line(arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("drillenv: ") and err.count("\n") == 1 and said in err
    assert not list(tmp_path.iterdir())
