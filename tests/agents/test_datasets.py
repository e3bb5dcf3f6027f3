"""`planarm dataset`: episodes of policies as Minari datasets, repeated to the bit, and read for training."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

import agents
from agents.cli import main
from agents.datasets import store
from agents.datasets.read import check_dataset, read_dataset
from agents.datasets.record import PLAN, record_dataset
from agents.datasets.store import open_dataset
from envs import task_card
from tests.pages import steps

minari = pytest.importorskip("minari")
pytest.importorskip("h5py")

BELT = "ConveyorTrack-v0"


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    return tmp_path / "datasets"


def repeat(dataset: Any) -> None:
    """Repeat every episode in a fresh environment, from its seed, options and actions; all comes out to the bit."""
    env = dataset.recover_environment()
    details = dataset.storage.get_episode_metadata(range(dataset.total_episodes))
    for episode, known in zip(dataset, details, strict=True):
        observation, info = env.reset(seed=known["seed"], options=known.get("options"))
        steps = [(observation, 0.0, False, False, info), *map(env.step, episode.actions)]
        observations, rewards, terminated, truncated, infos = zip(*steps, strict=True)
        assert np.array_equal(episode.observations, observations)
        assert np.array_equal(episode.rewards, rewards[1:])
        assert np.array_equal(episode.terminations, terminated[1:])
        assert np.array_equal(episode.truncations, truncated[1:])
        for key in set(episode.infos) - {PLAN}:
            assert np.array_equal(episode.infos[key], [info[key] for info in infos], equal_nan=True), key
    env.close()


@pytest.mark.parametrize(
    ("env_id", "policies", "settings", "options"),
    [
        (BELT, ["dpct", "apf", "random"], {"control_mode": "jerk", "payload": 0.2}, {"belt_speed": 0.15}),
        (BELT, ["apf"], {}, {"belt_speed": [0.1, 0.2]}),
        ("MinTorqueMove-v0", ["lagrange", "follower"], {"horizon": 0.8}, {}),
        ("ObstacleDodge-v0", ["apf", "dpct"], {}, {}),
        ("ExcavatorPayload-v0", ["agent"], {"level": 2}, {}),
    ],
)
def test_an_episode_is_repeated_to_the_bit(
    env_id: str, policies: list[str], settings: dict[str, Any], options: dict[str, Any]
) -> None:
    record_dataset("some/one-v0", env_id, policies, 2, seed=5, env_config=settings, options=options)
    dataset = minari.load_dataset("some/one-v0")
    assert dataset.total_episodes == 2 * len(policies)
    repeat(dataset)
    details = dataset.storage.metadata["planarm"]
    assert [each["policy"] for each in details["policies"]] == policies
    assert details["env_config"].items() >= settings.items()
    known = list(dataset.storage.get_episode_metadata(range(dataset.total_episodes)))
    assert [each["policy"] for each in known] == [name for name in policies for _ in range(2)]
    evaluation = agents.evaluate(policies[0], env_id, seeds=[5, 6], env_config=details["env_config"], options=options)
    assert [each["return"] for each in known[:2]] == pytest.approx(evaluation.returns, rel=1e-12)
    assert [each["is_success"] for each in known[:2]] == evaluation.success.tolist()


def test_the_plan_is_recorded_where_there_is_one() -> None:
    record_dataset("plans-v0", BELT, ["dpct", "apf"], 1)
    planned, reactive = minari.load_dataset("plans-v0")
    joints = planned.observations[:, :2]
    assert np.isfinite(planned.infos[PLAN][:50]).all()
    assert planned.infos[PLAN].shape == joints.shape
    assert np.isnan(reactive.infos[PLAN]).all()


def test_an_interrupted_recording_holds_the_episodes_so_far(root: Path) -> None:
    ended = []

    def interrupt(count: int) -> None:
        ended.append(count)
        if len(ended) == 3:
            raise KeyboardInterrupt

    recording = record_dataset("part-v0", BELT, ["random"], 10, progress=interrupt)
    assert not recording.finished
    assert minari.load_dataset("part-v0").total_episodes == 3
    assert [path.name for path in root.iterdir()] == ["part-v0"]


def test_an_interrupt_before_the_first_episode_leaves_nothing(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*given: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("agents.datasets.record.play", interrupt)
    with pytest.raises(KeyboardInterrupt):
        record_dataset("belt/none-v0", BELT, ["random"], 10)
    assert list(root.iterdir()) == []


def test_what_a_killed_recording_left_is_removed(root: Path) -> None:
    left = root / f".planarm-{2**22 + 1}-x" / "data"
    left.mkdir(parents=True)
    record_dataset("new-v0", BELT, ["random"], 1)
    assert [path.name for path in root.iterdir()] == ["new-v0"]


def test_a_dataset_is_replaced_only_if_asked_to() -> None:
    record_dataset("same-v0", BELT, ["random"], 1)
    with pytest.raises(ValueError, match="there is a dataset same-v0"):
        record_dataset("same-v0", BELT, ["random"], 2)
    record_dataset("same-v0", BELT, ["random"], 3, overwrite=True)
    assert minari.load_dataset("same-v0").total_episodes == 3


def test_a_folder_with_the_name_of_a_new_dataset_is_left_alone(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of a run: a path is a dataset to read, and never one to write."""
    monkeypatch.chdir(tmp_path)
    mine = tmp_path / "belt" / "random-v0" / "data" / "mine"
    mine.mkdir(parents=True)
    record_dataset("belt/random-v0", BELT, ["random"], 1, overwrite=True)
    assert mine.is_dir()
    assert (root / "belt" / "random-v0" / "data").is_dir()


def test_only_successes() -> None:
    recording = record_dataset("good-v0", "ObstacleDodge-v0", ["follower"], 8, only_successes=True)
    (recorded,) = recording.policies
    assert recorded.left_out > 0
    assert recorded.successes == len(recorded.returns) == minari.load_dataset("good-v0").total_episodes
    with pytest.raises(ValueError, match="none of the 2 episodes of each policy is a success"):
        record_dataset("bad-v0", BELT, ["random"], 2, only_successes=True)


def test_the_command_prints_how_to_load_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dataset", BELT, "--policies", "random", "--episodes", "2", "--out", "belt/random-v0"]) == 0
    assert 'minari.load_dataset("belt/random-v0")' in capsys.readouterr().out
    for wrong in ("no version", "belt", "belt/random", "b/random-v0", "../random-v0", ""):
        assert main(["dataset", BELT, "--out", wrong]) == 2
        assert "no id such as belt/dpct-v0" in capsys.readouterr().err
    assert main(["dataset", BELT, "--policies", "agent", "dpct", "--out", "two-v0"]) == 2
    assert "give the same settings" in capsys.readouterr().err


def test_without_minari_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(DependencyNotInstalled, match=r'pip install "planarm\[data\]"'):
        record_dataset("any-v0", BELT, ["random"], 1)


def test_a_setting_left_out_is_the_same_as_its_default() -> None:
    agent = agents.load_agent(BELT)
    explicit = replace(agent, document={**agent.document, "env_config": {**agent.env_config, "relative_motion": False}})
    record_dataset("alike-v0", BELT, {"one": agent, "other": explicit}, 1)
    one, other = minari.load_dataset("alike-v0").iterate_episodes()
    assert np.array_equal(one.actions, other.actions)
    with pytest.raises(ValueError, match=r'one acts with {"control_mode": "jerk"} and dpct with {}: a dataset has one'):
        record_dataset("unlike-v0", BELT, {"one": agent, "dpct": "dpct"}, 1)


def test_a_dataset_is_read_for_the_settings_it_was_recorded_in() -> None:
    record_dataset("jerk-v0", BELT, ["random"], 2, env_config={"control_mode": "jerk"})
    assert len(check_dataset("jerk-v0", BELT, {"control_mode": "jerk"})) == 64
    with pytest.raises(ValueError, match="control_mode 'jerk', and the run has 'torque'"):
        check_dataset("jerk-v0", BELT, {})
    with pytest.raises(ValueError, match="is of ConveyorTrack-v0, not of ObstacleDodge-v0"):
        check_dataset("jerk-v0", "ObstacleDodge-v0", {})
    with pytest.raises(ValueError, match="its episodes have changed"):
        check_dataset("jerk-v0", BELT, {"control_mode": "jerk"}, sha256="0" * 64)
    with pytest.raises(ValueError, match=r"with reset options {}, and the run has {'belt_speed': 0.1}"):
        check_dataset("jerk-v0", BELT, {"control_mode": "jerk"}, {"belt_speed": 0.1})
    with pytest.raises(ValueError, match="no dataset other-v0"):
        check_dataset("other-v0", BELT, {})
    first, second = read_dataset("jerk-v0")
    assert len(first.observations) == len(first.actions) + 1 == len(first.rewards) + 1
    assert not np.array_equal(first.actions, second.actions)


def test_infos_are_recorded_always_and_do_not_matter_to_training() -> None:
    agent = agents.load_agent(BELT)
    quiet = replace(agent, document={**agent.document, "env_config": {**agent.env_config, "info_terms": False}})
    record_dataset("full-v0", BELT, {"mine": quiet}, 1, env_config={"relative_motion": False})
    (episode,) = minari.load_dataset("full-v0").iterate_episodes()
    assert episode.infos.keys() >= {"is_success", PLAN, "reward_progress", "reward_settling", "reward_limits"}
    assert check_dataset("full-v0", BELT, {"control_mode": "jerk", "info_terms": False})
    with pytest.raises(ValueError, match="info_terms false leaves out the terms of the reward"):
        record_dataset("none-v0", BELT, ["random"], 1, env_config={"info_terms": False})


def test_the_metadata_hold_the_card_of_the_task() -> None:
    record_dataset("card-v0", "ObstacleDodge-v0", ["random"], 1)
    stored = minari.load_dataset("card-v0").storage.metadata["planarm"]["card"]
    card = task_card("ObstacleDodge-v0")
    assert [(each["key"], each["primary"]) for each in stored["metrics"]] == [
        (metric.key, metric.primary) for metric in card.metrics
    ]
    assert stored["experts"] == list(card.experts)
    assert stored["levels"].keys() == card.levels.keys()
    assert stored["levels"]["four_discs"]["settings"] == {"num_obstacles": 4}


@pytest.mark.parametrize("taken", ["belt/x-v0", "x-v0"])
def test_no_dataset_is_written_inside_another(taken: str) -> None:
    record_dataset(taken, BELT, ["random"], 1)
    for inner, reason in (("data/y-v0", "has a part data"), ("y-v0", f"would be inside dataset {taken}")):
        for overwrite in (False, True):
            with pytest.raises(ValueError, match=reason):
                record_dataset(f"{taken}/{inner}", BELT, ["random"], 1, overwrite=overwrite)
    with pytest.raises(ValueError, match="has a part data"):  # else a later dataset new-v0 would hold it
        record_dataset("new-v0/data/y-v0", BELT, ["random"], 1)
    assert minari.load_dataset(taken).total_episodes == 1


def test_no_dataset_is_written_around_another() -> None:
    record_dataset("belts-v0/slow/x-v0", BELT, ["random"], 1)
    for overwrite in (False, True):
        with pytest.raises(ValueError, match="around dataset belts-v0/slow/x-v0"):
            record_dataset("belts-v0", BELT, ["random"], 1, overwrite=overwrite)
    record_dataset("belts-v0/slow/x-v0", BELT, ["random"], 2, overwrite=True)
    assert minari.load_dataset("belts-v0/slow/x-v0").total_episodes == 2


def test_reading_a_dataset_runs_no_code_that_it_names(root: Path, tmp_path: Path) -> None:
    record_dataset("evil-v0", BELT, ["random"], 1)
    path = root / "evil-v0" / "data" / "metadata.json"
    metadata = json.loads(path.read_text())
    spec = json.loads(metadata["env_spec"])
    spec["entry_point"] = "evil_module:Evil"
    (tmp_path / "evil_module.py").write_text("raise SystemExit('ran')")
    del metadata["observation_space"]
    path.write_text(json.dumps({**metadata, "env_spec": json.dumps(spec)}))
    with pytest.raises(ValueError, match="does not describe the observations"):
        open_dataset("evil-v0")
    assert "evil_module" not in sys.modules


@pytest.mark.parametrize("damage", [b"", b"\x89HDF\r\n\x1a\n" + bytes(100), None])
def test_a_damaged_dataset_is_refused_in_a_sentence(root: Path, damage: bytes | None) -> None:
    record_dataset("hurt-v0", BELT, ["random"], 1)
    path = root / "hurt-v0" / "data" / "main_data.hdf5"
    path.write_bytes(path.read_bytes()[:2000] if damage is None else damage)
    with pytest.raises(ValueError, match="cannot read dataset hurt-v0"):
        read_dataset("hurt-v0")


RECIPE = ["env_config.control_mode=jerk", "hidden=[16]", "num_envs=4", "evaluation_episodes=2", "baselines=[]"]


@pytest.mark.rl
def test_cloning_a_dataset_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record_dataset("dodge/apf-v0", "ObstacleDodge-v0", ["apf"], 4, env_config={"control_mode": "velocity"})
    cloning = ["warm_start.updates=30", "warm_start.episodes=4", *RECIPE[1:]]
    for name in ("one", "two"):
        assert main(["train", "bc/ObstacleDodge-v0", *cloning, "--out", str(tmp_path / name)]) == 0
    one, two = (agents.load_agent(tmp_path / name) for name in ("one", "two"))
    observations = read_dataset("dodge/apf-v0")[0].observations
    assert np.array_equal(one.predict(observations)[0], two.predict(observations)[0])
    capsys.readouterr()
    assert main(["train", "bc/ObstacleDodge-v0", "warm_start.dataset=no/such-v0", "--out", str(tmp_path / "no")]) == 2
    assert "no dataset no/such-v0" in capsys.readouterr().err
    both = ["warm_start.expert=apf", "--out", str(tmp_path / "both")]
    assert main(["train", "bc/ObstacleDodge-v0", *both]) == 2
    assert "one of the two" in capsys.readouterr().err


@pytest.mark.rl
def test_a_run_does_not_go_on_with_another_dataset(tmp_path: Path) -> None:
    from agents.training.recipe import TrainingConfig
    from agents.training.run import TrainingRun, Watcher

    def record() -> None:
        record_dataset("belt/apf-v0", BELT, ["apf"], 2, env_config={"control_mode": "jerk"}, overwrite=True)

    record()
    changes = ["total_steps=0", "warm_start.dataset=belt/apf-v0", "warm_start.updates=20", "warm_start.episodes=2"]
    config = TrainingConfig.parse({"env": BELT}, "setting").overridden([*RECIPE, *changes])
    run = TrainingRun.begin(tmp_path / "run", config, "test")
    assert not run.train(Watcher(stop=lambda: True))
    resumed = TrainingRun.resume(tmp_path / "run")
    assert resumed.config.teacher is not None
    assert resumed.config.teacher.sha256 is not None
    record_dataset("belt/apf-v0", BELT, ["random"], 2, env_config={"control_mode": "jerk"}, overwrite=True)
    with pytest.raises(ValueError, match="its episodes have changed"):
        TrainingRun.resume(tmp_path / "run").train()
    record()
    assert TrainingRun.resume(tmp_path / "run").train()


@pytest.mark.rl
def test_a_replay_buffer_begins_with_a_dataset(tmp_path: Path) -> None:
    record_dataset("belt/apf-v0", BELT, ["apf"], 3, env_config={"control_mode": "jerk"})
    changes = ["total_steps=40", "learning_starts=0", "buffer_size=2000", "demonstrations={dataset: belt/apf-v0}"]
    assert main(["train", "sac/ConveyorTrack-v0", *RECIPE, *changes, "--out", str(tmp_path / "run")]) == 0
    with np.load(next((tmp_path / "run").glob("*.npz"))) as buffer:
        episodes = read_dataset("belt/apf-v0")
        assert np.array_equal(buffer["observations"][0], [episodes[0].observations[t] for t in range(4)])
        assert buffer["position"][1] == sum(len(each.actions) for each in episodes) // 4 + 10


ON_FULL_DISK = """
import io, os, sys
from agents.datasets import store

class Full(io.FileIO):
    def write(self, content):
        if self.tell() + len(content) > 100_000:
            raise OSError(28, "No space left on device")
        return super().write(content)

store.raw_file = lambda path: Full(path, "r+")
from agents.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_a_full_disk_is_named_and_nothing_is_left(root: Path) -> None:
    command = ["dataset", BELT, "--out", "full-v0", "--policies", "follower", "--episodes", "4"]
    done = subprocess.run([sys.executable, "-c", ON_FULL_DISK, *command], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].endswith("main_data.hdf5: No space left on device")
    assert "Traceback" not in done.stderr
    assert not list(root.iterdir())


def test_a_replacement_that_was_killed_halfway_is_ended_by_the_next_run(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record_dataset("same-v0", BELT, ["random"], 1)
    with monkeypatch.context() as killed:
        rename = os.rename

        def stop(source: Path, target: Path) -> None:
            if source.parent.name.startswith(store._DRAFT):
                raise KeyboardInterrupt
            rename(source, target)

        killed.setattr(os, "rename", stop)
        killed.setattr(store, "_delete", lambda draft: None)
        with pytest.raises(KeyboardInterrupt):
            record_dataset("same-v0", BELT, ["random"], 2, overwrite=True)
    assert not (root / "same-v0" / "data").exists()
    (draft,) = root.glob(f"{store._DRAFT}*")
    draft.rename(root / f"{store._DRAFT}99999999-x")
    record_dataset("other-v0", BELT, ["random"], 1)
    assert open_dataset("same-v0").total_episodes == 2
    assert not list(root.glob(f"{store._DRAFT}*"))


@pytest.mark.parametrize(
    ("what", "number", "message"),
    [
        ("actions", np.nan, "actions that are not finite"),
        ("actions", 50.0, "actions outside of"),
        ("rewards", np.nan, "rewards that are not finite"),
    ],
)
def test_numbers_that_no_policy_gave_are_refused_before_a_run_begins(
    root: Path, what: str, number: float, message: str
) -> None:
    record_dataset("bad-v0", BELT, ["random"], 2)
    (file,) = (root / "bad-v0").rglob("*.hdf5")
    with import_module("h5py").File(file, "r+") as content:
        content["episode_1"][what][3] = number
    with pytest.raises(ValueError, match=f"episode 1 of dataset bad-v0 has {message}"):
        check_dataset("bad-v0", BELT, {})


def test_options_that_cannot_be_stored_are_refused_before_the_first_episode() -> None:
    paths = {"obstacle_paths": [[[0.1, -0.4], [-0.3, -0.4], [0.0, -0.45]], [[-0.35, -0.3]]]}
    with pytest.raises(ValueError, match="lists of different lengths"):
        record_dataset("ragged-v0", "ObstacleDodge-v0", ["apf"], 1, env_config={"num_obstacles": 2}, options=paths)


def test_a_dataset_of_an_own_task_is_read_and_recovered(tmp_path: Path, root: Path) -> None:
    """In a process of its own, which finds the task's module by the name in the dataset."""
    page = (Path(__file__).parents[2] / "docs" / "extend" / "task.md").read_text()
    (file,) = (step for step in steps(page) if step.kind == "file" and step.name == "circle_task.py")
    (tmp_path / "circle_task.py").write_text(file.text)
    code = (
        "import warnings; warnings.simplefilter('error')\n"
        "from agents.datasets.record import record_dataset\n"
        "from agents.datasets.read import check_dataset\n"
        "record_dataset('own-v0', 'circle_task:Circle-v0', ['follower'], 1)\n"
        "print(len(check_dataset('own-v0', 'Circle-v0', {})))"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(agents.__file__).parents[1])])}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "64", done.stderr
    recover = "import envs, minari; print(minari.load_dataset('own-v0').recover_environment().unwrapped.task.env_id)"
    done = subprocess.run([sys.executable, "-c", recover], env=environment, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "Circle-v0", done.stderr
