"""Damaged and hostile files of every kind are refused in a sentence, at once, and run no code."""

from __future__ import annotations

import resource
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tools.fuzz_files.checks import check, check_drawn, watch
from tools.fuzz_files.readers import READERS

LITTLE_MIB = 300.0
"""Memory that reading damaged files may take."""


@pytest.fixture(scope="module", autouse=True)
def watched() -> None:
    watch()


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[pytest.mark.rl] if kind == "checkpoint" else []) for kind in READERS]
)
def test_damaged_files_are_read_or_refused_in_a_sentence(kind: str) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    outcomes = [check(kind, 0, number) for number in range(60)]
    assert [outcome.fault for outcome in outcomes if outcome.fault] == []
    assert any(outcome.refused for outcome in outcomes)
    assert any(not check(kind, 1, number).refused for number in range(300))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0 - before < LITTLE_MIB


@given(kind=st.sampled_from(sorted({*READERS} - {"checkpoint"})), random=st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_what_hypothesis_damages_is_read_or_refused_in_a_sentence(kind: str, random: Random) -> None:
    assert check_drawn(kind, random).fault is None
