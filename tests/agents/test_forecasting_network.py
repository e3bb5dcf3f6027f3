"""From features to a mixture of paths, and how a forecaster is kept in files."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import agents.policies.forecasting
from agents.policies.forecasting import Forecaster, load_forecaster, save_forecaster
from agents.policies.forecasting.features import FEATURES, disc_features
from agents.policies.forecasting.forecaster import describe_network, is_forecaster
from agents.policies.forecasting.futures import KNOT_STEPS, KNOTS, OUTPUTS, PATHS, SPREAD, expect, going_on, knot_table
from agents.policies.forecasting.policy import aimed_move
from agents.policies.forecasting.track import follow_disc, new_tracks
from envs.obstacle_dodge.paths import FARTHEST, NEAREST, PATH_STEP
from planners import SCARA_50CM
from planners.apf.safety import STEP
from planners.typing import Array

ARM = SCARA_50CM
MOVE = aimed_move(ARM, ARM.limits, np.array([-0.5, 1.0]), ARM.forward_kinematics([1.2, 1.4]))
HIDDEN = (6, 5)


def forecaster(scale: float = 1.0, seed: int = 0) -> Forecaster:
    """One with weights at random."""
    generator = np.random.default_rng(seed)
    tensors: dict[str, Any] = {
        "mean": generator.standard_normal(FEATURES),
        "spread": generator.uniform(0.5, 2, FEATURES),
    }
    sizes = (FEATURES, *HIDDEN, OUTPUTS)
    for layer in range(3):
        tensors[f"weight{layer}"] = scale * generator.standard_normal((sizes[layer + 1], sizes[layer]))
        tensors[f"bias{layer}"] = scale * generator.standard_normal(sizes[layer + 1])
    tensors = {name: tensor.astype(np.float32) for name, tensor in tensors.items()}
    return Forecaster(describe_network(tensors), tensors)


def disc(seed: int) -> Any:
    """The track of a disc that has been seen three times, on its way somewhere."""
    generator = np.random.default_rng(seed)
    angle, away = generator.uniform(-math.pi, math.pi), generator.uniform(NEAREST + 0.1, FARTHEST - 0.1)
    place, track = away * np.array([math.cos(angle), math.sin(angle)]), new_tracks(1)[0]
    velocity = generator.uniform(-0.7, 0.7, 2)
    for _ in range(3):
        follow_disc(track, MOVE, place, velocity)
        place = place + 2 * PATH_STEP * velocity
    return track


def mixture(one: Forecaster, track: Any, steps: int = KNOT_STEPS[-1]) -> tuple[Array, Array]:
    places, weights = np.full((PATHS, steps, 2), np.nan), np.full(PATHS, np.nan)
    expect(track, MOVE, one.network, knot_table(steps), places, weights)
    return places, weights


def test_the_knot_table_says_how_far_it_is_to_the_next_knot() -> None:
    steps = KNOT_STEPS[-1]
    table = knot_table(steps)
    knots, shares = table[:, 0].astype(int), table[:, 1]
    assert (shares > 0.0).all()
    assert (shares <= 1.0).all()
    assert tuple(table[-1]) == (KNOTS - 1, 1.0)
    ends = np.array([0, *KNOT_STEPS])
    np.testing.assert_allclose(
        (1.0 - shares) * ends[knots] + shares * ends[knots + 1], np.arange(1, steps + 1), rtol=1e-12
    )
    np.testing.assert_array_equal(knot_table(7), table[:7])


def test_a_forecast_beyond_the_last_knot_is_refused() -> None:
    with pytest.raises(ValueError, match=r"3\.1 s ahead, not 3\.15 s"):
        knot_table(KNOT_STEPS[-1] + 1)


@pytest.mark.parametrize("seed", range(20))
def test_a_network_of_zeros_says_that_a_disc_goes_on_within_the_rims(seed: int) -> None:
    track = disc(seed)
    places, weights = mixture(forecaster(scale=0.0), track)
    on = np.array([going_on(track, STEP * step) for step in range(1, KNOT_STEPS[-1] + 1)])
    away = np.hypot(*on.T)[:, None]
    np.testing.assert_allclose(
        places, np.broadcast_to(on / away * np.clip(away, NEAREST, FARTHEST), places.shape), rtol=1e-12
    )
    np.testing.assert_allclose(weights, 1.0 / PATHS)


@pytest.mark.parametrize("scale", [0.3, 30.0])
def test_places_stay_in_the_world_and_probabilities_sum_to_one(scale: float) -> None:
    for seed in range(40):
        places, weights = mixture(forecaster(scale, seed), disc(seed))
        away = np.hypot(places[..., 0], places[..., 1])
        assert away.min() >= NEAREST - 1e-12
        assert away.max() <= FARTHEST + 1e-12
        assert (weights >= 0.0).all()
        assert weights.sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_paths_are_what_the_layers_give_in_the_discs_frame(seed: int) -> None:
    """Against the network in NumPy, one matrix a layer, and np.interp between the knots."""
    one, track = forecaster(0.15, seed), disc(seed)
    tensors = {name: tensor.astype(float) for name, tensor in one.tensors.items()}
    features = np.empty(FEATURES)
    c, s = disc_features(track, MOVE, features)
    values = (features - tensors["mean"]) / tensors["spread"]
    for layer in range(3):
        values = tensors[f"weight{layer}"] @ values + tensors[f"bias{layer}"]
        values = np.maximum(values, 0.0) if layer < 2 else values
    displaced = SPREAD * STEP * np.array(KNOT_STEPS)[:, None] * values[:-PATHS].reshape(PATHS, KNOTS, 2)
    chances = np.exp(values[-PATHS:]) / np.exp(values[-PATHS:]).sum()
    places, weights = mixture(one, track)
    np.testing.assert_allclose(weights, chances, rtol=1e-9)
    steps = np.arange(1, KNOT_STEPS[-1] + 1)
    on = np.array([going_on(track, STEP * step) for step in steps])
    compared = 0
    for path in range(PATHS):
        along, across = (np.interp(steps, [0, *KNOT_STEPS], [0.0, *displaced[path, :, axis]]) for axis in range(2))
        wanted = on + np.stack([c * along - s * across, s * along + c * across], axis=1)
        inside = (np.hypot(*wanted.T) > NEAREST) & (np.hypot(*wanted.T) < FARTHEST)
        np.testing.assert_allclose(places[path][inside], wanted[inside], atol=1e-9)
        compared += int(inside.sum())
    assert compared > 20


def test_what_is_saved_is_loaded_bit_for_bit(tmp_path: Path) -> None:
    one, path = forecaster(), tmp_path / "one.safetensors"
    save_forecaster(one, path)
    for source in (path, str(path)):
        again = load_forecaster(source)
        assert again.tensors.keys() == one.tensors.keys()
        for name, tensor in one.tensors.items():
            np.testing.assert_array_equal(again.tensors[name], tensor)
            assert again.tensors[name].dtype == tensor.dtype
        assert {name: again.document[name] for name in one.document} == dict(one.document)
    save_forecaster(again, tmp_path / "two.safetensors")
    assert (tmp_path / "two.safetensors").read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"features": FEATURES + 1}, f"with {FEATURES + 1} features and {OUTPUTS} outputs.*train it anew"),
        ({"outputs": 7}, f"{FEATURES} features and 7 outputs"),
        ({"env": "ConveyorTrack-v0"}, "is for ConveyorTrack-v0"),
        ({"hidden": [3, 5]}, r"weight0 has shape .* not \(3, 37\) as its JSON says"),
        ({"format": 99}, "format 99"),
        ({"sha256": "0"}, "do not belong together"),
    ],
)
def test_what_is_wrong_with_a_forecaster_is_said(tmp_path: Path, changes: dict[str, Any], complaint: str) -> None:
    path = tmp_path / "one.safetensors"
    save_forecaster(forecaster(), path)
    document = path.with_suffix(".json")
    document.write_text(json.dumps({**json.loads(document.read_text()), **changes}))
    with pytest.raises(ValueError, match=complaint):
        load_forecaster(path)


def test_missing_and_damaged_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "one.safetensors"
    with pytest.raises(ValueError, match=r"one\.safetensors"):
        load_forecaster(path)
    whole = forecaster()
    lacking = {name: tensor for name, tensor in whole.tensors.items() if name not in ("mean", "bias2")}
    save_forecaster(Forecaster(whole.document, lacking), path)
    with pytest.raises(ValueError, match="lacks mean, bias2"):
        load_forecaster(path)
    save_forecaster(Forecaster({"format": 1, "env": "ObstacleDodge-v0"}, whole.tensors), path)
    with pytest.raises(ValueError, match="lacks features, outputs, hidden"):
        load_forecaster(path)
    save_forecaster(whole, path)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(ValueError, match=r"cannot read.*one\.safetensors"):
        load_forecaster(path)


def test_a_forecaster_is_known_by_its_document(tmp_path: Path) -> None:
    path = tmp_path / "one.safetensors"
    assert not is_forecaster(path)
    save_forecaster(forecaster(), path)
    assert is_forecaster(path)
    agent = Path(agents.__file__).parent / "trained" / "ObstacleDodge-v0.safetensors"
    assert agent.exists()
    assert not is_forecaster(agent)


def test_the_shipped_forecaster_is_small_and_fits_its_document() -> None:
    shipped = load_forecaster()
    assert shipped.document["env"] == "ObstacleDodge-v0"
    described = describe_network(shipped.tensors)
    assert {name: shipped.document[name] for name in described} == described
    sizes = (FEATURES, *shipped.document["hidden"], OUTPUTS)
    for layer in range(3):
        assert shipped.tensors[f"weight{layer}"].shape == (sizes[layer + 1], sizes[layer])
        assert shipped.tensors[f"bias{layer}"].shape == (sizes[layer + 1],)
    assert (shipped.tensors["spread"] > 0.0).all()
    folder = Path(agents.policies.forecasting.__file__).parent / "trained"
    assert (folder / "ObstacleDodge-v0.safetensors").stat().st_size < 300_000
    errors = shipped.document["training"]["errors"]
    assert errors["best"] < errors["likeliest"] < 0.6 * errors["going_on"]
