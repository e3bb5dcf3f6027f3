"""Submissions checked: scored on the public and the sealed list, beside the policies of the leaderboard."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.evaluation.benchmark import Benchmark
from agents.evaluation.scoreboard import Scoreboard
from agents.submissions.card import Claims
from agents.submissions.claims import agreement, claims_of
from agents.submissions.folder import Submission, leaderboard_config, read_submission
from agents.submissions.sealed import SealedList, commitment
from agents.yaml_config import refuse_twice

Run = Callable[[Benchmark], Scoreboard]
"""Runs a benchmark to its end."""


@dataclass(frozen=True)
class Verdict:
    """What became of a submission.

    Attributes:
        folder: where it is.
        accepted: whether it is one, and its claimed numbers come out.
        reason: why, in a sentence.
        submission: None if the folder holds none.
        scored: its scores on the public list, None if it cannot be scored.
        public: its scores beside those of others on the public list, None if it is refused.
        sealed: likewise on the sealed list, None without one too.
    """

    folder: Path
    accepted: bool
    reason: str
    submission: Submission | None = None
    scored: Claims | None = None
    public: Scoreboard | None = None
    sealed: Scoreboard | None = None

    def document(self, sealed: SealedList | None) -> dict[str, Any]:
        """Everything, for JSON; of the sealed list no episodes and no seeds."""
        return {
            "folder": str(self.folder),
            "accepted": self.accepted,
            "reason": self.reason,
            "card": self.submission and self.submission.card.model_dump(mode="json"),
            "scored": self.scored and self.scored.model_dump(mode="json"),
            "public": self.public and self.public.document(),
            "sealed": self.sealed and sealed and _without_episodes(self.sealed, sealed),
        }


def check(
    folder: Path, run: Run, *, episodes: int | None, against: Sequence[str] | None, sealed: SealedList | None
) -> Verdict:
    """Score a submission and compare it, if its claimed numbers come out.

    Args:
        folder: of the submission.
        run: runs each benchmark.
        episodes: most episodes of a task, fewer than those of the leaderboard for a trial; None for all.
        against: policies to compare with; those of the leaderboard if None.
        sealed: the sealed list, if it is known here.

    Raises:
        ValueError: if one of the policies to compare with fails.
    """
    submission, scored = None, None
    try:
        submission = read_submission(folder)
        scored = claims_of(run(benchmark_of(submission, (), episodes)))
        reason = agreement(submission.card.claims, scored)
        if sealed is not None:
            run(benchmark_of(submission, (), episodes, sealed))  # alone: what fails from here on is another policy
    except ValueError as error:
        return Verdict(folder, False, " ".join(str(error).split()), submission, scored)
    public = run(benchmark_of(submission, against, episodes))
    hidden = None if sealed is None else run(benchmark_of(submission, against, episodes, sealed))
    return Verdict(folder, True, f"the claimed numbers {reason}", submission, scored, public, hidden)


def require_comparable(folders: Sequence[Path], against: Sequence[str]) -> None:
    """Raise a ValueError unless there are these policies, each once, and they can act in the tasks of submissions.

    A folder without a submission is left to `check`, which says why.
    """
    refuse_twice(against, "policy")
    for folder in folders:
        try:
            submission = read_submission(folder)
        except ValueError:
            continue
        refuse_twice((submission.card.name, *against), "policy")
        if against:
            tasks = tuple(task.model_copy(update={"policies": tuple(against)}) for task in submission.tasks)
            Benchmark(leaderboard_config().model_copy(update={"tasks": tasks})).check()


def benchmark_of(
    submission: Submission, against: Sequence[str] | None, episodes: int | None = None, sealed: SealedList | None = None
) -> Benchmark:
    """The leaderboard of a submission's tasks, with its agent; on the sealed list without tasks of one episode."""
    config, name = leaderboard_config(), submission.card.name
    tasks, seeds = [], {}
    for task in submission.tasks:
        most = task.episodes or config.episodes
        number = min(most, episodes or most)
        others = task.policies or config.policies if against is None else against
        changes = {"policies": (name, *others), "episodes": number, "bound_episodes": 0}
        if sealed is not None:
            if most == 1:
                continue
            seeds[task.title] = sealed.seeds(task.title, number)
        tasks.append(task.model_copy(update=changes))
    config = config.model_copy(update={"tasks": tuple(tasks), "policies": (name,), "bound_episodes": 0, "replays": 0})
    return Benchmark(config, compared=(name,), given={name: submission.agent}, seeds=seeds)


def _without_episodes(board: Scoreboard, sealed: SealedList) -> dict[str, Any]:
    """Summaries and differences, with the hash of the list."""
    results = [
        {
            "task": result["task"],
            "policies": [{name: each[name] for name in ("policy", "summary")} for each in result["policies"]],
            "pairs": result["pairs"],
        }
        for result in board.document()["results"]
    ]
    return {"release": sealed.release, "sha256": commitment(sealed.secret), "open": sealed.open, "results": results}
