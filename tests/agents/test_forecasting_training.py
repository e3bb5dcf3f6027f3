"""Training of the forecaster: repeatable, learning, and the same network as the one that acts; needs the `rl` extra."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason='needs pip install "planarm[rl]"')

import torch

from agents.policies.forecasting import Forecaster, load_forecaster, save_forecaster
from agents.policies.forecasting.features import FEATURES, disc_features
from agents.policies.forecasting.futures import KNOT_STEPS, KNOTS, PATHS, expect, going_on, knot_table
from agents.policies.forecasting.policy import aimed_move
from agents.policies.forecasting.track import follow_disc, new_tracks
from envs.obstacle_dodge.paths import FARTHEST, NEAREST, PATH_STEP
from planners import SCARA_50CM
from planners.apf.safety import STEP
from tools.forecaster.command import ForecasterOptions, run
from tools.forecaster.config import ForecastConfig
from tools.forecaster.training import Mixture, Samples, distances, draw_samples, fit, judge, surprise

ARM = SCARA_50CM
TINY = ForecastConfig.parse(
    {"episodes": 600, "samples": 8, "hidden": 16, "epochs": 6, "batch_size": 64}, "forecaster setting"
)


@pytest.fixture(scope="module")
def samples() -> Samples:
    return draw_samples(TINY, 0)


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Any:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def tensors_of(forecaster: Forecaster) -> dict[str, Any]:
    return {name: np.asarray(tensor) for name, tensor in forecaster.tensors.items()}


def test_the_same_seed_draws_the_same_discs_and_another_others(samples: Samples) -> None:
    count = TINY.episodes * TINY.samples
    assert samples.features.shape == (count, FEATURES)
    assert samples.displacements.shape == (count, KNOTS, 2)
    again, other = draw_samples(TINY, 0), draw_samples(TINY, 1)
    np.testing.assert_array_equal(again.features, samples.features)
    np.testing.assert_array_equal(again.displacements, samples.displacements)
    assert (other.features != samples.features).mean() > 0.5
    assert np.isfinite(samples.features).all()
    # A disc is hardly ever anywhere else than where it goes in the first tenth of a second.
    near, far = np.hypot(*np.moveaxis(samples.displacements[:, [0, -1]], 2, 0)).T
    assert np.quantile(near, 0.9) < 0.01
    assert np.median(far) > 0.3


def test_the_same_seed_gives_the_same_weights_and_another_others(samples: Samples) -> None:
    first, again, other = (tensors_of(fit(TINY, samples, seed)) for seed in (3, 3, 4))
    for name, tensor in first.items():
        np.testing.assert_array_equal(again[name], tensor)
    assert (other["weight1"] != first["weight1"]).any()


@pytest.fixture(scope="module")
def told_and_trained(samples: Samples) -> tuple[list[str], Forecaster]:
    lines: list[str] = []
    return lines, fit(TINY, samples, 0, lines.append)


def test_surprise_falls_and_forecasts_beat_that_a_disc_goes_on(
    told_and_trained: tuple[list[str], Forecaster], samples: Samples
) -> None:
    lines, trained = told_and_trained
    assert [line.split(":")[0] for line in lines] == [f"epoch {epoch} of {TINY.epochs}" for epoch in range(1, 7)]
    told = [float(line.split("surprise ")[1].split(",")[0]) for line in lines]
    errors = trained.document["training"]["errors"]
    assert told[-1] == pytest.approx(errors["surprise"], abs=1e-3)
    assert told[-1] < told[1] < told[0]
    assert errors["best"] < errors["likeliest"] < 0.65 * errors["going_on"]
    held_out = len(samples.features) // 12
    learnt = samples.features[held_out:]
    untrained = Mixture(learnt.mean(axis=0), learnt.std(axis=0) + 1e-3, TINY.hidden)
    chance = judge(
        untrained, *(torch.from_numpy(part[:held_out]) for part in (samples.features, samples.displacements))
    )
    assert errors["surprise"] < 0.6 * chance["surprise"]
    assert errors["going_on"] == pytest.approx(chance["going_on"], rel=1e-6)


def test_what_is_trained_says_how_and_is_kept(told_and_trained: tuple[list[str], Forecaster], tmp_path: Path) -> None:
    _, trained = told_and_trained
    training = trained.document["training"]
    assert ForecastConfig.parse(training["config"], "forecaster setting") == TINY
    assert (training["seed"], training["samples"]) == (0, 4400)
    save_forecaster(trained, tmp_path / "tiny.safetensors")
    for name, tensor in load_forecaster(tmp_path / "tiny.safetensors").tensors.items():
        np.testing.assert_array_equal(tensor, trained.tensors[name])


def test_surprise_is_that_of_the_mixture_in_numpy() -> None:
    generator = np.random.default_rng(0)
    paths, truth = generator.normal(0, 0.2, (5, PATHS, KNOTS, 2)), generator.normal(0, 0.2, (5, KNOTS, 2))
    chances = generator.dirichlet(np.ones(PATHS), 5)
    ahead = STEP * np.array(KNOT_STEPS)
    apart = np.hypot(*np.moveaxis(paths - truth[:, None], 3, 0))
    likelihood = (chances * np.exp(-3.0 * (apart / (0.02 + 0.08 * ahead)).mean(axis=2))).sum(axis=1)
    args = [torch.tensor(part, dtype=torch.float32) for part in (paths, np.log(chances), truth)]
    np.testing.assert_allclose(distances(args[0], args[2]).numpy(), apart, atol=4e-3)
    assert float(surprise(*args)) == pytest.approx(-np.log(likelihood).mean(), rel=2e-3)


def test_the_network_that_acts_is_the_one_that_was_trained(told_and_trained: tuple[list[str], Forecaster]) -> None:
    """Where the rims do not cut it: displacements in the disc's frame, and probabilities."""
    trained = told_and_trained[1]
    network = Mixture(trained.tensors["mean"], trained.tensors["spread"], TINY.hidden)
    for i, layer in enumerate(network.layers):
        layer.weight.data = torch.from_numpy(trained.tensors[f"weight{i}"])
        layer.bias.data = torch.from_numpy(trained.tensors[f"bias{i}"])
    move = aimed_move(ARM, ARM.limits, np.array([-0.5, 1.0]), ARM.forward_kinematics([1.2, 1.4]))
    places, weights, table = np.empty((PATHS, KNOT_STEPS[-1], 2)), np.empty(PATHS), knot_table(KNOT_STEPS[-1])
    compared = 0
    for seed in range(20):
        generator = np.random.default_rng(seed)
        angle, velocity = generator.uniform(-3.0, 3.0), generator.uniform(-0.4, 0.4, 2)
        place, track, features = 0.8 * np.array([np.cos(angle), np.sin(angle)]), new_tracks(1)[0], np.empty(FEATURES)
        for _ in range(4):
            follow_disc(track, move, place, velocity)
            place = place + 2 * PATH_STEP * velocity
        c, s = disc_features(track, move, features)
        expect(track, move, trained.network, table, places, weights)
        with torch.no_grad():
            paths, logs = network(torch.tensor(features[None], dtype=torch.float32))
        np.testing.assert_allclose(weights, np.exp(logs[0].numpy()), atol=1e-5)
        for knot, step in enumerate(KNOT_STEPS):
            along, across = paths[0, :, knot].numpy().T
            on_x, on_y = going_on(track, STEP * step)
            wanted = np.stack([on_x + c * along - s * across, on_y + s * along + c * across], axis=1)
            inside = (np.hypot(*wanted.T) > NEAREST) & (np.hypot(*wanted.T) < FARTHEST)
            np.testing.assert_allclose(places[inside, step - 1], wanted[inside], atol=1e-5)
            compared += int(inside.sum())
    assert compared > 400


@pytest.mark.parametrize("wrong", [{"episodes": 5}, {"batch_size": 1}, {"learning_rate": 0.0}, {"epoch": 3}])
def test_settings_without_sense_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        ForecastConfig.parse(wrong, "forecaster setting")


def test_the_command_trains_every_seed_and_keeps_the_best(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tiny = ("episodes=24", "samples=4", "hidden=8", "epochs=1", "batch_size=32")
    assert run(ForecasterOptions(changes=tiny, seeds=(3, 5), episodes=3, out=tmp_path)) == 0
    table = capsys.readouterr().out
    best = load_forecaster(tmp_path / "ObstacleDodge-v0.safetensors")
    chosen = best.document["training"]["seed"]
    assert f"**{chosen}**, shipped" in table
    merits = {entry["seed"]: entry["selection"]["success"] for entry in best.document["seeds"]}
    assert sorted(merits) == [3, 5]
    assert merits[chosen] == max(merits.values())
    assert best.document["held_out"]["seeds"] == [0, 2]
    kept = load_forecaster(tmp_path / f"seed-{chosen}.safetensors")
    for name, tensor in best.tensors.items():
        np.testing.assert_array_equal(kept.tensors[name], tensor)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"changes": ("epoch=3",)}, 'did you mean "epochs"'),
        ({"changes": ("hidden=0",)}, "hidden"),
        ({"seeds": ()}, "at least one training seed"),
        ({"seeds": (-1,)}, "none of them negative"),
        ({"episodes": 0}, "episodes 0"),
    ],
)
def test_the_command_says_what_is_wrong(tmp_path: Path, options: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        run(ForecasterOptions(**{"out": tmp_path, **options}))
    assert not list(tmp_path.iterdir())
