"""What the pictures show, and that they show it legibly, alike each time and fast."""

import itertools
import math
import sys
import time

import gymnasium as gym
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.path import Path as Outline
from matplotlib.text import Text

import drillenv
from benchmarks.peers import paper_problem, scipy_rig
from drillenv.checks import InputError
from drillenv.dynamics.flow import make_model
from drillenv.env import rendering
from drillenv.env.plant import INTERVAL
from drillenv.env.rendering import HEIGHT, WIDTH, Renderer, Scale, peaks_of, step_above, strong_branch, zone
from drillenv.env.scalar import DrillEnv
from drillenv.env.truth import T_DEPTH, T_LABEL, T_LARGEST, T_MEAN, T_PERIOD, TRUTH_SIZE
from drillenv.rig import Rig

RIG = (265.0, 3.0, 68.85e3, 2.45e3, 1.0, 1.0)
# README: below these p / A in bar/V strong P-1-I-1 lives, at 80, 100 and 120 Hz on cases 1 to 6
PUBLISHED = {
    1: (12.07e6, 13.70e6, 1.737, 2.365, 3.061),
    2: (11.82e6, 13.90e6, 1.724, 2.351, 3.047),
    3: (11.72e6, 13.41e6, 1.747, 2.384, 3.097),
    4: (21.40e6, 25.05e6, 1.495, 1.986, 2.509),
    5: (32.73e6, 40.64e6, 1.365, 1.799, 2.259),
    6: (22.03e6, 27.14e6, 1.460, 1.939, 2.447),
}


def action(frequency, amplitude, pressure):
    return np.array([(frequency - 85) / 35, (amplitude - 0.45) / 0.15, (pressure - 1.2) / 0.6], dtype=np.float32)


def drilled(env, settings, **reset):
    """The frames of an episode."""
    env.reset(**reset)
    frames = [env.render()]
    for setting in settings:
        env.step(action(*setting))
        frames.append(env.render())
    return frames


@pytest.fixture
def env():
    made = []

    def make(kind="rock", **more):
        made.append(DrillEnv(kind, render_mode="rgb_array", **more))
        return made[-1]

    yield make
    for one in made:
        one.close()


# what the frames are


def test_frames_are_arrays_of_one_shape(env):
    frames = drilled(env("layers"), [(110, 0.45, 1.0), (50, 0.6, 1.8), (120, 0.3, 0.6)], seed=1)
    assert {(frame.shape, frame.dtype) for frame in frames} == {((HEIGHT, WIDTH, 3), np.dtype(np.uint8))}
    assert all(frame.flags.writeable and frame.flags.c_contiguous for frame in frames)
    for one, other in itertools.pairwise(frames):
        assert (one != other).mean() > 0.005


@pytest.mark.slow
def test_one_seed_gives_the_same_frames_in_one_environment_and_in_another(env):
    settings = [(110, 0.45, 1.0), (60, 0.6, 1.8), (118, 0.5, 1.2), (118, 0.5, 1.2)]
    first = env("hidden")
    once = drilled(first, settings, seed=3)
    again = drilled(first, settings, seed=3)
    other = drilled(env("hidden"), settings, seed=3)
    for frames in (again, other):
        assert all(np.array_equal(a, b) for a, b in zip(once, frames, strict=True))
    assert not np.array_equal(once[-1], drilled(first, settings, seed=4)[-1])


def test_rendering_twice_changes_nothing_and_frames_are_ones_own(env):
    made = env()
    frame = drilled(made, [(110, 0.45, 1.0)], seed=1)[-1]
    kept = frame.copy()
    frame[:] = 0
    assert np.array_equal(made.render(), kept)


@pytest.mark.slow
def test_a_users_style_does_not_show(env):
    settings = [(110, 0.45, 1.0), (90, 0.6, 1.8)]
    usual = drilled(env(rock=4), settings, seed=1)
    loud = {
        "font.size": 30,
        "axes.grid": False,
        "lines.linewidth": 9,
        "axes.unicode_minus": False,
        "font.weight": "bold",
    }
    with mpl.rc_context(
        {**loud, "text.color": "red", "xtick.bottom": False, "axes.xmargin": 0.4, "hatch.linewidth": 4}
    ):
        styled = drilled(env(rock=4), settings, seed=1)
    assert all(np.array_equal(a, b) for a, b in zip(usual, styled, strict=True))


def test_nothing_of_pyplot_is_touched(env):
    pyplot = sys.modules.get("matplotlib.pyplot")
    before = None if pyplot is None else pyplot.get_fignums()
    drilled(env(), [], seed=1)
    pyplot = sys.modules.get("matplotlib.pyplot")
    assert before == (None if pyplot is None else pyplot.get_fignums())


@pytest.mark.slow
def test_all_texts_lie_inside_the_frame_and_apart(env):
    cases = [
        (env(rock=5), [(50, 0.6, 0.6)] * 4),
        (env(rock=1), [(120, 0.3, 1.8)] * 4),
        (env(rock=4), [(60, 0.3, 1.8)] * 10),
        (env("layers", scenario="beyond"), [(120, 0.6, 1.8), (90, 0.45, 0.6)] * 20),
        (env(rock={"loading_stiffness": 1e9, "unloading_stiffness": 1e9}), [(120, 0.6, 1.8)] * 3),
        (env(rock={"loading_stiffness": 1e5, "unloading_stiffness": 2e5}), [(120, 0.6, 1.8)] * 10),
        (env(rock=4, reward={"rating": 100.0}), [(120, 0.6, 1.8)] * 2),
        (env(rock=4, reward={"rating": 1e5}), [(120, 0.6, 1.8)] * 2),
    ]
    for made, settings in cases:
        for count in range(len(settings) + 1):
            if count == 0:
                made.reset(seed=2)
            else:
                made.step(action(*settings[count - 1]))
            made.render()
        assert_legible(made._renderer)


def assert_legible(renderer):
    canvas = renderer._canvas.get_renderer()
    boxes = []
    for axes in renderer.figure.axes:
        for text in axes.findobj(Text):
            if text.get_visible() and text.get_text().strip() and shows(axes, text):
                boxes.append((text.get_text(), text.get_window_extent(canvas), text.get_fontsize()))
    assert len(boxes) > 50
    for content, box, size in boxes:
        assert box.x0 >= 4 and box.y0 >= 2 and box.x1 <= WIDTH - 4 and box.y1 <= HEIGHT - 4, content
        assert size >= 9.0, content
    for (one, a, _), (other, b, _) in itertools.combinations(boxes, 2):
        apart = min(a.x1, b.x1) - max(a.x0, b.x0) < 1 or min(a.y1, b.y1) - max(a.y0, b.y0) < 2
        assert apart, f"{one!r} covers {other!r}"


def shows(axes, text):
    """Whether a text is drawn: matplotlib keeps labels of ticks beyond an axis' ends."""
    for axis in (axes.xaxis, axes.yaxis):
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
            if text in (tick.label1, tick.label2):
                low, high = sorted(axis.get_view_interval())
                return axes.axison and low - 1e-9 <= tick.get_loc() <= high + 1e-9
    return axes.axison or text in axes.texts


# what they tell


def test_peaks_are_the_turns_of_the_force_that_the_load_cell_sees():
    force = np.array([0, 40, 0, 60, 100, 80, 300, 300, 10, 0, 0, 500.0])
    assert peaks_of(force).tolist() == [4, 6]


def test_the_motion_is_said_in_words():
    def words(period, impacts, mean, largest):
        truth = np.zeros(TRUTH_SIZE)
        truth[[T_PERIOD, T_LABEL, T_MEAN, T_LARGEST]] = period, impacts, mean, largest
        return rendering.motion_in_words(truth, 2.0)[:2]

    assert words(1, 1, 1500.0, 1510.0) == ("P-1-I-1", "one blow a period, 75 % of the rating")
    assert words(1, 1, 2100.0, 2110.0) == ("P-1-I-1", "one blow a period, above the rating")
    assert words(1, 3, 700.0, 1510.0) == ("P-1-I-3", "3 blows a period")
    assert words(2, 3, 700.0, 1510.0) == ("P-2-I-3", "3 blows in 2 periods")
    assert words(2, 1, 700.0, 1510.0) == ("P-2-I-1", "1 blow in 2 periods")
    assert words(0, 0, 700.0, 1510.0)[0] == "no period"


@pytest.mark.slow
def test_the_clock_counts_and_stops_where_intervals_were_not_drawn(env):
    made = env(rock=4)
    drilled(made, [(110, 0.45, 1.0)] * 3, seed=1)
    header = made._renderer._header
    assert header.clock == 4 * INTERVAL
    made.render()
    assert header.clock == 4 * INTERVAL
    kept = made.get_state()
    made.step(action(110, 0.45, 1.0))
    made.render()
    assert header.clock == 5 * INTERVAL
    # back in time: what came before is not known to the picture
    made.set_state(kept)
    made.render()
    assert header.clock is None
    made.reset(seed=2)
    made.render()
    assert header.clock == INTERVAL
    made.step(action(110, 0.45, 1.0))
    made.step(action(110, 0.45, 1.0))
    made.render()
    assert header.clock is None
    assert len(made._renderer._panels[-1].past) == 1


@pytest.mark.slow
def test_the_trail_holds_the_settings_that_were_and_starts_anew_with_an_episode(env):
    made = env(rock=4)
    drilled(made, [(110, 0.4, 0.6), (110, 0.5, 0.6)], seed=1)
    trail = made._renderer._panels[-1].past
    assert [round(amplitude, 6) for amplitude, _ in trail] == [0.45, 0.4, 0.5]
    drilled(made, [], seed=2)
    assert len(trail) == 1


@pytest.mark.slow
def test_rock_below_the_face_is_marked_as_not_drilled(env):
    made = env("layers")
    drilled(made, [(115, 0.5, 1.1)] * 12, seed=1)
    strata = made._renderer._panels[2]
    depth = made._batch.truths[0, T_DEPTH]
    assert depth > 3.0
    assert strata.ahead.get_y() == depth
    assert strata.ahead.get_y() + strata.ahead.get_height() == pytest.approx(25.0)


def test_layers_are_cut_to_what_shows():
    layers = np.array([[10e6, 12e6, 5e-3, 1], [30e6, 40e6, 12e-3, 5], [20e6, 22e6, np.inf, 4]])
    assert rendering.rock_bands(layers, 2.0, 8.0) == [(2.0, 5.0, 10e6), (5.0, 8.0, 30e6)]
    assert rendering.rock_bands(layers, 13.0, 50.0) == [(13.0, 50.0, 20e6)]


def test_scales_go_in_steps_and_shrink_only_after_a_while():
    scale = Scale(1.0, 2.5, 5.0)
    assert [scale.over(need) for need in (0.4, 2.0, 0.4)] == [1.0, 2.5, 2.5]
    for _ in range(rendering.CALM):
        last = scale.over(0.4)
    assert last == 1.0
    assert step_above(21.0, (1.0, 5.0)) == 40.0
    assert step_above(math.nan, (1.0, 5.0)) == 5.0


# the map


@pytest.mark.parametrize("case", PUBLISHED)
def test_the_map_ends_where_the_atlas_found_it(case):
    loading, unloading, *ends = PUBLISHED[case]
    for frequency, published in zip((80.0, 100.0, 120.0), ends, strict=True):
        assert strong_branch(frequency, loading, unloading, RIG).ratio[-1] == pytest.approx(published, abs=2e-3)


def test_the_map_is_found_on_all_rocks_of_the_scenarios_and_rigs_of_the_hidden_physics():
    rng = np.random.default_rng(1)
    for _ in range(60):
        loading = float(np.exp(rng.uniform(np.log(4e6), np.log(70e6))))
        rig = np.array(RIG) + rng.normal(0, 1, 6) * (1.0, 0.01, 2000.0, 75.0, 0.015, 0.02)
        branch = strong_branch(rng.uniform(85, 120), loading, loading * rng.uniform(1.05, 1.6), tuple(rig.tolist()))
        assert branch.ratio.size > 3
        assert branch.ratio[0] < 1.0 < branch.ratio[-1]
        assert (np.diff(branch.ratio) > 0).all()
        assert np.isfinite(branch.force).all()


def test_there_is_no_map_where_strong_single_blows_lie_outside_the_settings():
    assert strong_branch(50.0, 32.73e6, 40.64e6, RIG).ratio.size == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "frequency", "amplitude", "pressure"), [(4, 120.0, 0.5, 1.0), (2, 100.0, 0.45, 0.8), (5, 110.0, 0.6, 0.7)]
)
def test_peak_forces_of_the_map_are_those_of_an_independent_solver(case, frequency, amplitude, pressure):
    loading, unloading, *_ = PUBLISHED[case]
    problem = paper_problem(loading, unloading, frequency, amplitude, pressure, 0.0)
    motion = scipy_rig.simulate(problem, int(2.4 * frequency), rtol=1e-8, atol=1e-12, max_step=5e-4)
    # a blow of force F leaves F (1 / k_l - 1 / k_u) behind
    advance = np.diff(motion.penetration)[-4:].mean()
    peak = advance / (1.0 / loading - 1.0 / unloading)
    branch = strong_branch(frequency, loading, unloading, RIG)
    shown = amplitude * np.interp(pressure / amplitude, branch.ratio, branch.force)
    assert shown == pytest.approx(peak, rel=1e-3)


@pytest.mark.slow
def test_the_map_agrees_with_what_the_rig_does(env):
    record = {"loading_stiffness": 21.4e6, "unloading_stiffness": 25.05e6}
    made = env(rock=record)
    drilled(made, [(118, 0.45, 0.95)] * 16, seed=1)
    truth, rig = made._batch.truths[0], made._batch.plants.rigs[0]
    branch = rendering.branch_at(truth, rig)
    assert (truth[T_PERIOD], truth[T_LABEL]) == (1, 1)
    shown = 0.45 * np.interp(0.95 / 0.45, branch.ratio, branch.force)
    assert shown == pytest.approx(truth[T_LARGEST], rel=5e-3)


def test_a_zone_holds_the_settings_with_such_peaks_and_no_others():
    branch = strong_branch(110.0, 21.4e6, 25.05e6, RIG)
    levels = (1500.0, 2000.0)
    outlines = [Outline(zone(branch, *ends)) for ends in itertools.pairwise((0.0, *levels, math.inf))]
    rng = np.random.default_rng(2)
    found = np.zeros(4, dtype=int)
    for amplitude, pressure in zip(rng.uniform(0.3, 0.6, 600), rng.uniform(0.6, 1.8, 600), strict=True):
        ratio = pressure / amplitude
        force = amplitude * np.interp(ratio, branch.ratio, branch.force)
        if min(abs(force - level) for level in levels) < 5:  # an outline is made of straight pieces
            continue
        place = int(np.searchsorted(levels, force)) if ratio < branch.ratio[-1] else 3
        found[place] += 1
        inside = [bool(outline.contains_point((amplitude, pressure))) for outline in outlines]
        assert inside == [place == 0, place == 1, place == 2]
    assert (found > 10).all()


def test_a_rig_that_the_exact_engine_cannot_take_has_no_map():
    # the characteristic polynomial in contact is (s^2 + 1000 s + 1e6)^2: both modes are one
    rig = (4.0, 4.0, 2e6, 4e3, 1.0, 1.0)
    loading = 8e6
    with pytest.raises(InputError, match="two modes"):
        make_model(Rig(*rig), drillenv.Rock(loading, 1.1 * loading), drillenv.Setting(100, 0.45, 1.0))
    assert strong_branch(100.0, loading, 1.1 * loading, rig).ratio.size == 0


# speed


@pytest.mark.thorough
@pytest.mark.slow
def test_a_frame_costs_less_than_drawing_the_figure_anew(env):
    # measured side by side: how many seconds a drawing takes is a matter of the machine
    made = env("layers")
    drilled(made, [(110, 0.45, 1.0)] * 3, seed=1)
    renderer = made.unwrapped._renderer
    rng, costs, whole = np.random.default_rng(0), [], []
    for _ in range(40):
        made.step(np.clip(rng.normal(0, 0.5, 3), -1, 1).astype(np.float32))
        costs.append(seconds_of(made.render))
        whole.append(seconds_of(renderer._canvas.draw))
    assert np.median(costs) < 0.6 * np.median(whole)
    assert max(costs) < 2 * np.median(whole)


def seconds_of(call) -> float:
    """Processor seconds of a call."""
    begin = time.process_time()
    call()
    return time.process_time() - begin


def test_a_new_frequency_or_rock_costs_the_map_little():
    strong_branch(100.0, 20e6, 25e6, RIG)
    begin = time.process_time()
    for place in range(20):
        strong_branch(90.0 + 0.31 * place, 20e6, 25e6, RIG)
    assert (time.process_time() - begin) / 20 < 0.05


# the window


class FakeManager:
    def __init__(self):
        self.shown = False
        self.title = ""

    def show(self):
        self.shown = True

    def set_window_title(self, title):
        self.title = title


class FakeCanvas(FigureCanvasAgg):
    """A canvas that says it has a window, and draws into memory."""

    required_interactive_framework = "fake"

    def start_event_loop(self, timeout=0):
        # what is due next is reckoned by the clock, which has to go on
        time.sleep(timeout)
        self.waited = getattr(self, "waited", 0.0) + timeout


@pytest.fixture
def screen(monkeypatch):
    """The figures opened as windows."""
    from matplotlib import pyplot

    opened = []

    def figure(**how):
        made = Figure(**how)
        FakeCanvas(made).manager = FakeManager()
        opened.append(made)
        return made

    monkeypatch.setattr(pyplot, "figure", figure)
    monkeypatch.setattr(pyplot, "close", opened.remove)
    return opened


@pytest.mark.slow
def test_the_window_shows_the_frames_as_they_happen(screen, env):
    settings = [(110, 0.45, 1.0), (118, 0.5, 1.2)]
    seen = DrillEnv("rock", rock=4, render_mode="human")
    seen.reset(seed=1)
    for setting in settings:
        seen.step(action(*setting))
    assert seen.render() is None
    (figure,) = screen
    assert figure.canvas.manager.shown
    assert figure.canvas.manager.title == "drillenv"
    # three intervals drawn, and the last one again: waits of about an interval less the work
    assert 0.0 < figure.canvas.waited < 4 * INTERVAL
    last = drilled(env(rock=4), settings, seed=1)[-1]
    shown = np.asarray(figure.canvas.buffer_rgba())[..., :3]
    assert np.array_equal(shown, last)
    seen.close()
    seen.close()
    assert not screen


def test_after_the_user_closed_the_window_the_episode_goes_on(screen):
    seen = DrillEnv("rock", rock=4, render_mode="human")
    seen.reset(seed=1)
    (figure,) = screen
    before = np.asarray(figure.canvas.buffer_rgba()).copy()
    figure.canvas.callbacks.process("close_event", None)
    seen.step(action(110, 0.45, 1.0))
    assert np.array_equal(np.asarray(figure.canvas.buffer_rgba()), before)
    seen.close()


@pytest.mark.parametrize("backend", ["agg", "tkagg"])
def test_without_a_screen_one_line_says_what_to_do(backend, monkeypatch):
    from matplotlib import pyplot

    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    if backend == "tkagg" and not sys.platform.startswith("linux"):
        pytest.skip("only Linux runs without a screen")
    before = mpl.rcParams["backend"]
    if backend == "agg":
        pyplot.switch_backend("agg")
    else:
        monkeypatch.setattr(pyplot, "figure", lambda **_: pyplot.switch_backend("tkagg"))
    seen = DrillEnv("rock", rock=4, render_mode="human")
    with pytest.raises(InputError, match="rgb_array") as caught:
        seen.reset(seed=1)
    assert "\n" not in str(caught.value)
    assert pyplot.get_fignums() == []
    seen.close()
    pyplot.switch_backend(before)


def test_another_mode_is_refused():
    with pytest.raises(InputError, match="render_mode"):
        Renderer("ansi")


# with Gymnasium


def test_frames_are_collected_by_gymnasiums_wrapper():
    made = gym.wrappers.RenderCollection(
        gym.make("drillenv/DrillLayers-v0", render_mode="rgb_array", disable_env_checker=True)
    )
    made.reset(seed=1)
    made.step(np.zeros(3, dtype=np.float32))
    frames = made.render()
    assert [frame.shape for frame in frames] == [(HEIGHT, WIDTH, 3)] * 2
    made.close()


def test_a_video_is_recorded(tmp_path):
    pytest.importorskip("moviepy")
    made = gym.wrappers.RecordVideo(
        gym.make("drillenv/Drill-v0", render_mode="rgb_array", disable_env_checker=True), str(tmp_path)
    )
    made.reset(seed=1)
    for _ in range(3):
        made.step(np.zeros(3, dtype=np.float32))
    made.close()
    assert next(tmp_path.glob("*.mp4")).stat().st_size > 10_000


@pytest.mark.slow
def test_the_picture_of_the_documentation_can_be_made(tmp_path):
    rendering.write_picture(tmp_path / "frame.png")
    assert imread(tmp_path / "frame.png").shape[:2] == (HEIGHT, WIDTH)
    assert [file.name for file in tmp_path.iterdir()] == ["frame.png"]
    with pytest.raises(InputError, match="cannot write"):
        rendering.write_picture(tmp_path / "nowhere" / "frame.png")
