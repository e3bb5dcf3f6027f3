"""What planarm reads as data, each with a valid example and the ways in which it is damaged."""

from __future__ import annotations

import hashlib
import io
import json
from abc import ABC, abstractmethod
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
import numpy as np
import yaml
from safetensors.numpy import save

import envs
from agents.environments import check_names, task_type
from agents.evaluation.benchmark_config import BenchmarkConfig
from agents.policies.agent import FORMAT, NORMALIZED
from agents.policies.files import describe_layout, layout_of, load_agent
from agents.submissions.card import Claims, read_card, write_claims
from agents.submissions.folder import read_submission
from agents.training.learning_curves import read_curve
from agents.training.recipe import TrainingConfig
from agents.yaml_config import assigned, load_config
from planners import SCARA_50CM, FixedJoints, MotionProblem, Trajectory, arm_document, arm_names, load_arm, quintic
from tools.fuzz_files.mutations import CANARY, STRANGE, changed, changed_bytes, changed_text, yaml_bytes

CONFIGS = Path(__file__).parent.parent.parent / "configs"
ENV = "ConveyorTrack-v0"


class Reader(ABC):
    """One kind of file.

    Attributes:
        imports: whether reading it may import a module that it names, as ``module:name`` in a benchmark does.
        names_file: whether messages name the file.
    """

    imports = False
    names_file = True

    @abstractmethod
    def write(self, folder: Path, random: Random) -> None:
        """Write a damaged example into a folder."""

    @abstractmethod
    def read(self, folder: Path) -> object:
        """Read it as planarm does."""


class ArmFile(Reader):
    """An arm in YAML or JSON."""

    def write(self, folder: Path, random: Random) -> None:
        """Another arm every time."""
        document = arm_document(random.choice(arm_names()))
        content = yaml_bytes(document, random)
        if random.random() < 0.4:
            content = json.dumps(changed(document, random)).encode()
            content = changed_bytes(content, random) if random.random() < 0.5 else content
        (folder / random.choice(("arm.yaml", "arm.json"))).write_bytes(content)

    def read(self, folder: Path) -> object:
        """Read and write it as a document."""
        return arm_document(load_arm(next(folder.iterdir())))


class Experiment(Reader):
    """The YAML of a training run."""

    def write(self, folder: Path, random: Random) -> None:
        """A shipped configuration, changed."""
        document = yaml.safe_load(random.choice(sorted(CONFIGS.glob("*/*-v0.yaml"))).read_text())
        (folder / "mine.yaml").write_bytes(yaml_bytes(document, random))

    def read(self, folder: Path) -> object:
        """Read and validate it."""
        return load_config(str(folder / "mine.yaml"), TrainingConfig)


class BenchmarkFile(Reader):
    """The YAML of a benchmark."""

    imports = True

    def write(self, folder: Path, random: Random) -> None:
        """The shipped one, changed."""
        document = yaml.safe_load((CONFIGS / "benchmark.yaml").read_text())
        (folder / "mine.yaml").write_bytes(yaml_bytes(document, random))

    def read(self, folder: Path) -> object:
        """Read and validate it."""
        return load_config(str(folder / "mine.yaml"), BenchmarkConfig)


class Changes(Reader):
    """Settings and reset options of the command line, ``key=value``."""

    names_file = False

    def write(self, folder: Path, random: Random) -> None:
        """One to three, in lines."""
        task = task_type(random.choice(envs.env_ids()))
        lines = [task.env_id]
        for _ in range(random.randint(1, 3)):
            name = random.choice([*task.config_type.model_fields, *task.options_type.model_fields, "task_type", "a.b"])
            value = random.choice((random.choice(STRANGE), random.uniform(-3.0, 3.0), "torque", [0.1, 0.2]))
            text = json.dumps(value) if random.random() < 0.7 else changed_text(json.dumps(value), random)
            lines.append(f"{name}={text}".replace("\n", " ").replace("\r", " "))
        (folder / "changes").write_text("\n".join(lines), encoding="utf-8", errors="replace", newline="")

    def read(self, folder: Path) -> object:
        """Make the environment and reset it with what are options."""
        env_id, *changes = (folder / "changes").read_text(encoding="utf-8").split("\n")
        given = assigned({}, changes)
        options = {name: given.pop(name) for name in set(given) & set(task_type(env_id).options_type.model_fields)}
        check_names(env_id, given, options)
        if "arm" in given or given.get("physics_step") or given.get("horizon"):
            return task_type(env_id).config_type.parse(given, "setting")
        env = gym.make(env_id, **given)
        try:
            return env.reset(seed=0, options=options)
        finally:
            env.close()


class AgentFiles(Reader):
    """Weights and JSON of an agent."""

    def write(self, folder: Path, random: Random) -> None:
        """The header, the tensors, the JSON or the bytes are changed; mostly with the right hash."""
        document, tensors = _agent()
        kind = random.randrange(5)
        if random.random() < 0.5:
            size = tensors["layer0.weight"].shape[1] - 2
            normal = {"mean": np.zeros(size), "std": np.ones(size), "clip": np.array([10.0])}
            document = {**document, "format": FORMAT + NORMALIZED}
            tensors = {**tensors, **{f"normal.{name}": value for name, value in normal.items()}}
        if kind == 0:
            tensors = {name: _tensor(value, random) for name, value in tensors.items()}
        content = save(tensors)
        if kind == 1:
            length = int.from_bytes(content[:8], "little")
            header = json.dumps(changed(json.loads(content[8 : 8 + length]), random)).encode()
            length = random.choice((len(header), len(header), 2**40, 0, length))
            content = length.to_bytes(8, "little") + header + content[8 + len(header) :]
        if kind == 2:
            content = changed_bytes(content, random)
        text = json.dumps({**document, "sha256": hashlib.sha256(content).hexdigest()})
        if kind == 3:
            text = json.dumps(changed(json.loads(text), random))
        if kind == 4:
            text = changed_text(text, random)
        (folder / "best.safetensors").write_bytes(content)
        (folder / "best.json").write_text(text, encoding="utf-8", errors="replace")

    def read(self, folder: Path) -> object:
        """Load it, and act once."""
        agent = load_agent(folder)
        return agent.predict(np.zeros((3, agent.observation_size), np.float32))


class SubmissionFolder(Reader):
    """The card of a submission, beside an agent."""

    def write(self, folder: Path, random: Random) -> None:
        """The card is changed, in YAML or in JSON."""
        document, tensors = _agent()
        content = save(tensors)
        text = json.dumps({**document, "sha256": hashlib.sha256(content).hexdigest()})
        (folder / "agent.safetensors").write_bytes(content)
        (folder / "agent.json").write_text(text)
        card = json.dumps(changed(_CARD, random)).encode() if random.random() < 0.3 else yaml_bytes(_CARD, random)
        (folder / random.choice(("card.yaml", "card.yaml", "card.json"))).write_bytes(card)

    def read(self, folder: Path) -> object:
        """Read it, and put claims into the card of one that is a submission."""
        submission = read_submission(folder)
        path = next(folder.glob("card.*"))
        write_claims(path, Claims.parse(_CARD["claims"], "claims"))
        card = read_card(path)
        assert card == submission.card.model_copy(update={"claims": card.claims})
        return card


class TrajectoryFile(Reader):
    """A saved trajectory."""

    def write(self, folder: Path, random: Random) -> None:
        """The arrays, the document in it, or the bytes are changed."""
        arrays, content, kind = dict(_trajectory()[1]), _trajectory()[0], random.randrange(3)
        if kind == 0:
            name = random.choice(sorted(arrays))
            arrays[name] = _tensor(arrays[name], random)
        if kind == 1:
            arrays["about"] = np.array(json.dumps(changed(json.loads(str(arrays["about"])), random)))
        if kind < 2:
            stream = io.BytesIO()
            np.savez(stream, allow_pickle=True, **arrays)
            content = stream.getvalue()
        else:
            content = changed_bytes(content, random)
        (folder / "motion.npz").write_bytes(content)

    def read(self, folder: Path) -> object:
        """Load it."""
        return repr(Trajectory.load(folder / "motion.npz"))


class RunFolder(Reader):
    """The files of a training run that curves are drawn from."""

    def write(self, folder: Path, random: Random) -> None:
        """The settings or the metrics are changed."""
        config = {"env": ENV, "total_steps": 200}
        metrics = "steps,seconds,success,return,expert,expert_success,expert_return\n100,1.5,0.5,1.0,dpct,1.0,1.3\n"
        settings, table = yaml.safe_dump(config).encode(), metrics.encode()
        if random.random() < 0.3:
            settings = yaml_bytes(config, random)
        else:
            table = changed_bytes(changed_text(metrics, random).encode(errors="replace"), random)
        (folder / "config.yaml").write_bytes(settings)
        (folder / "metrics.csv").write_bytes(table)

    def read(self, folder: Path) -> object:
        """Read its curve."""
        curve = read_curve(folder)
        return curve.finished, curve.best


class Checkpoint(Reader):
    """The checkpoint of a training run, and the settings and origin that it must fit; needs torch."""

    def write(self, folder: Path, random: Random) -> None:
        """One of the three is changed."""
        contents = dict(_checkpoint())
        kind = random.randrange(4)
        if kind == 0:
            contents["run.json"] = json.dumps(changed(json.loads(contents["run.json"]), random)).encode()
        elif kind == 1:
            contents["config.yaml"] = yaml_bytes(yaml.safe_load(contents["config.yaml"]), random)
        else:
            contents["checkpoint.pt"] = changed_bytes(contents["checkpoint.pt"], random)
        for name, content in contents.items():
            (folder / name).write_bytes(content)

    def read(self, folder: Path) -> object:
        """Read them as a resumed run does, up to the networks."""
        from agents.training.folder import check_files, check_origin
        from agents.training.state_file import read_state

        check_files(folder)
        config = load_config(str(folder / "config.yaml"), TrainingConfig)
        return read_state(folder / "checkpoint.pt", check_origin(folder, config))


def _tensor(value: np.ndarray[Any, Any], random: Random) -> np.ndarray[Any, Any]:
    """An array of another shape, type or content; mostly the same."""
    kind = random.randrange(24)
    if kind == 0:
        return value.reshape(-1)[: random.randint(0, value.size)].copy()
    if kind == 1:
        return value.astype(random.choice(("f2", "f8", "i1", "u8", "?", "c8"))) if value.dtype.kind in "fi" else value
    if kind == 2 and value.dtype.kind in "fi" and value.size:
        changed_value = value.copy()
        numbers = (np.nan, np.inf, 1e38, -1.0) if value.dtype.kind == "f" else (2**62, -(2**62), 10**6, -1)
        changed_value.reshape(-1)[random.randrange(value.size)] = random.choice(numbers)
        return changed_value
    if kind == 3:
        return np.repeat(value[None], 3, axis=0)
    return value


@cache
def _trajectory() -> tuple[bytes, dict[str, np.ndarray[Any, Any]]]:
    """The bytes of a saved trajectory, and its arrays."""
    motion = quintic.plan(MotionProblem(SCARA_50CM, np.array([0.0, 1.0]), FixedJoints(np.array([0.4, 1.2])), 2.0))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "motion.npz"
        motion.save(path)
        with np.load(path) as stored:
            return path.read_bytes(), {name: stored[name] for name in stored.files}


@cache
def _checkpoint() -> dict[str, bytes]:
    """The files of a run with a checkpoint of one tensor."""
    import torch

    from agents.training.folder import check_origin
    from agents.training.state_file import write_state

    config = TrainingConfig.parse({"env": ENV, "total_steps": 200, "hidden": [4]}, "setting")
    settings = config.model_dump(mode="json")
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "config.yaml").write_text(yaml.safe_dump(settings))
        (folder / "run.json").write_text(json.dumps({"config": settings}))
        state = {"steps": 3, "parameters": {"weight": torch.zeros(4, 5)}, "rows": [{"steps": 3, "success": 0.5}]}
        write_state(folder / "checkpoint.pt", check_origin(folder, config), state)
        return {path.name: path.read_bytes() for path in folder.iterdir()}


@cache
def _agent() -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
    """The JSON and the tensors of a small agent."""
    layout, generator = layout_of(ENV, {}), np.random.default_rng(0)
    shapes = {"layer0.weight": (5, layout.size + 2), "layer0.bias": (5,), "layer1.weight": (2, 5), "layer1.bias": (2,)}
    tensors: dict[str, Any] = {name: generator.standard_normal(shape, np.float32) for name, shape in shapes.items()}
    tensors |= {"log_std": np.zeros(2, np.float32), "fine.index": np.array([1, 3]), "fine.gain": np.ones(2, np.float32)}
    document = {"format": FORMAT, "env": ENV, "env_config": {"horizon": 2.0}, **describe_layout(layout)}
    return {**document, "activation": "tanh", "hidden": [5]}, tensors


_CARD: dict[str, Any] = {
    "format": 1,
    "name": "mine",
    "authors": ["Ada Lovelace"],
    "tasks": [ENV, f"{ENV}/paper"],
    "settings": {"control_mode": "torque"},
    "training": "PPO, then by hand",
    "steps": 400_000,
    "seconds": 310.5,
    "licence": "CC-BY-4.0",
    "link": "https://example.org/mine",
    "claims": {
        "platform": {"system": "Linux", "numpy": "2.4.6"},
        "tasks": {
            ENV: {
                **{"episodes": 128, "success": 127, "steps": 19200, "returns": 1.25, "metric": "settling_time"},
                **{"median": 1.1, "digest": "0123456789abcdef" * 4},
            }
        },
    },
}

READERS: dict[str, Reader] = {
    "arm": ArmFile(),
    "experiment": Experiment(),
    "benchmark": BenchmarkFile(),
    "changes": Changes(),
    "agent": AgentFiles(),
    "submission": SubmissionFolder(),
    "trajectory": TrajectoryFile(),
    "run": RunFolder(),
    **({"checkpoint": Checkpoint()} if find_spec("torch") else {}),
}
"""All of them, by name; checkpoints where torch is installed."""

__all__ = ["CANARY", "READERS", "Reader"]
