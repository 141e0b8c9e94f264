"""Play as datasets of Minari: read back by that library, and played again by the environment that it recovers."""

import numpy as np
import pytest

from drillenv import cli, controllers
from drillenv.training.rollout import rollout

minari = pytest.importorskip("minari")
SHORT = ["--scenario", "validation", "--episodes", "3", "--steps", "6", "--threads", "1"]


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    return tmp_path / "datasets"


def recorded(name, *players):
    assert cli.main(["record", "--controllers", *players, "--dataset", name, *SHORT]) == 0
    return minari.load_dataset(name)


@pytest.mark.parametrize("player", ["rules", "mpc"])
def test_read_back_it_is_what_was_played(root, player):
    dataset = recorded(f"drillenv/{player}-v0", player)
    assert dataset.total_episodes == 3 and dataset.total_steps == 18
    made = rollout(lambda: controllers.make(player), "DrillLayers", "validation", 3, 6, threads=1)
    env = dataset.recover_environment()
    assert env.spec.id == "drillenv/DrillLayers-v0" and env.spec.kwargs["scenario"] == "validation"
    for i, episode in enumerate(dataset.iterate_episodes()):
        np.testing.assert_array_equal(episode.observations, made.observations[i])
        np.testing.assert_array_equal(episode.actions, made.actions[i])
        np.testing.assert_array_equal(episode.rewards, made.rewards[i])
        assert episode.truncations.tolist() == [False] * 5 + [True] and not episode.terminations.any()
        # played again, to the last bit
        seen, _ = env.reset(seed=i, options={"episode": i})
        np.testing.assert_array_equal(seen, episode.observations[0])
        for k, action in enumerate(episode.actions):
            seen, reward, *_ = env.step(action)
            np.testing.assert_array_equal(seen, episode.observations[k + 1])
            assert reward == episode.rewards[k]


def test_mixed_play_takes_turns(root):
    dataset = recorded("drillenv/mixed-v0", "rules", "random")
    assert dataset.storage.metadata["algorithm_name"] == "rules, random"
    for i, episode in enumerate(dataset.iterate_episodes()):
        made = rollout(lambda i=i: controllers.make(("rules", "random")[i % 2]), "DrillLayers", "validation", i + 1, 6)
        np.testing.assert_array_equal(episode.actions, made.actions[i])
        assert set(episode.infos["controller"].tolist()) == {i % 2}


def test_it_is_written_whole_or_not_at_all(root, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", "datasets")  # from here
    recorded("drillenv/rules-v0", "rules")
    before = {file: file.read_bytes() for file in root.rglob("*") if file.is_file()}
    capsys.readouterr()
    (tmp_path / "file").write_text("", encoding="utf-8")
    for arguments, said in (
        (["--dataset", "drillenv/rules-v0"], "dataset drillenv/rules-v0 is in"),
        (["--dataset", "no name"], "give a name such as drillenv/rules-v0"),
        (["--dataset", "a-v0", "--env", "CartPole-v1"], "env is 'CartPole-v1'"),
        (["--dataset", "a-v0", "--episodes", "1000"], "episodes is 1000"),
        (["--dataset", "a-v0", "--out", str(tmp_path / "file")], "cannot write to"),
    ):
        assert cli.main(["record", "--controllers", "rules", *SHORT, *arguments]) == 2
        out, err = capsys.readouterr()
        assert out == "" and err.startswith("drillenv: ") and err.count("\n") == 1 and said in err

    def fails(*_):
        raise OSError(28, "no space left")

    monkeypatch.setattr("drillenv.training.datasets._write", fails)
    assert cli.main(["record", "--controllers", "rules", "--dataset", "drillenv/b-v0", *SHORT]) == 2
    assert {file: file.read_bytes() for file in root.rglob("*") if file.is_file()} == before
    assert sorted(each.name for each in root.iterdir()) == ["drillenv"]
