"""The search for the gains of the dodging field, on a handful of seeds."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from planners.apf.dodge.gains import DodgeGains, tuned_gains
from tools.tune_apf import FIRST_SEED, SPREAD, Search, TuneOptions, main, run_field, score


def test_a_candidate_stays_within_a_factor_of_the_start_and_keeps_what_is_known() -> None:
    start = tuned_gains()
    search = Search(start, np.arange(FIRST_SEED, FIRST_SEED + 1))
    candidate = asdict(search.candidate(np.full(len(search.names), 1.0)))
    for name, value in asdict(start).items():
        assert value <= candidate[name] <= SPREAD * value * (1.0 + 1e-12)
    assert (candidate["nearest"], candidate["farthest"]) == (start.nearest, start.farthest)
    assert candidate["evade"] <= 1.0


def test_the_score_counts_collisions_more_than_lateness() -> None:
    evaluation = run_field(tuned_gains(), np.arange(FIRST_SEED, FIRST_SEED + 40))
    failures = int((~evaluation.success).sum())
    assert failures <= score(evaluation) <= 1.3 * failures


@pytest.mark.slow
def test_a_search_stores_gains_that_load_and_how_they_were_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tools.tune_apf.tuned_gains", lambda: DodgeGains(horizon=0.3, nearest=0.32, farthest=1.3))
    out = tmp_path / "gains.json"
    main(TuneOptions(seeds=60, generations=1, population=6, confirm=60, out=out))
    stored = json.loads(out.read_text())
    assert stored["recipe"]["confirmed_score"] < stored["recipe"]["confirmed_score_before"]
    assert stored["recipe"]["seeds"] == [FIRST_SEED, FIRST_SEED + 59]
    DodgeGains(**stored["gains"])
