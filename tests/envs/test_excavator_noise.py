import numpy as np
import pytest
from scipy import stats

from envs.excavator_payload.kernels import add_noise
from envs.hashing import GAMMA, normal_pair, to_unit, uniform

SPLITMIX_OF_1234567 = (6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431)
"""The published first outputs for this seed."""


def test_known_numbers() -> None:
    for count, known in enumerate(SPLITMIX_OF_1234567):
        assert uniform(1234567, count) == (known >> 11) * 2.0**-53


def test_arrays_hash_like_numbers() -> None:
    words = np.arange(1, 5, dtype=np.uint64) * GAMMA + np.uint64(1234567)
    np.testing.assert_array_equal(to_unit(words), [uniform(1234567, count) for count in range(4)])


@pytest.mark.parametrize("seed", [0, 1, 2**63 - 1])
def test_pairs_are_normal_and_independent(seed: int) -> None:
    pairs = np.array([normal_pair(seed, count) for count in range(20000)])
    assert stats.kstest(pairs.ravel(), "norm").pvalue > 1e-3
    assert abs(np.corrcoef(pairs.T)[0, 1]) < 0.03
    assert abs(np.corrcoef(pairs[:-1, 0], pairs[1:, 0])[0, 1]) < 0.03


def test_neighbouring_seeds_are_independent() -> None:
    one, other = (np.array([normal_pair(seed, count)[0] for count in range(20000)]) for seed in (41, 42))
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.03


def test_no_number_is_used_twice_in_an_episode() -> None:
    measured = np.zeros((601, 2, 3))
    for step, sample in enumerate(measured):
        add_noise(7, step, (1.0, 0.5), sample)
    assert len(np.unique(np.abs(measured))) == measured.size
    np.testing.assert_allclose(measured.std(axis=(0, 2)), [1.0, 0.5], rtol=0.05)
