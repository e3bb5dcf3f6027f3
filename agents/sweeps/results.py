"""The results of a sweep: each trial's state and scores, as tables, JSON and CSV."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from agents.evaluation.summarise import card_of
from agents.sweeps.axes import value_text
from agents.sweeps.sweep import Sweep, Trial, rows_so_far
from agents.tables import Table, number_text, percent_text
from agents.training.learning_curves import Row, merit
from planners.documents import read_document
from planners.files import write_json, write_text

State = Literal["waiting", "running", "done", "stopped", "failed"]
_MOST_BYTES = 1 << 27


@dataclass
class Record:
    """What is known of a trial.

    ``stopped`` is one that ASHA has ended, ``failed`` one that cannot be trained or has lost too many workers.
    """

    trial: Trial
    state: State = "waiting"
    rows: list[Row] = field(default_factory=list)  # of its checkpoints
    error: str = ""  # why it has failed
    losses: int = 0  # workers that it has lost

    @property
    def best(self) -> Row | None:
        """The scores at the best checkpoint: most success, then the highest return."""
        return max(self.rows, key=merit, default=None)

    def add(self, row: Row) -> None:
        """Take over the scores of a checkpoint, unless they are known."""
        if not self.rows or row["steps"] > self.rows[-1]["steps"]:
            self.rows.append(row)


class SweepResults:
    """The records of all trials of a sweep; `write` keeps them in its folder."""

    def __init__(self, sweep: Sweep) -> None:
        """As the folder has them."""
        self.sweep = sweep
        self.records = {trial.name: Record(trial) for trial in sweep.trials}
        before = _before(sweep.folder / "results.json")
        for name, record in self.records.items():
            known = before.get(name, {})
            lost = known.get("workers_lost")
            record.losses = lost if isinstance(lost, int) else 0
            record.rows = rows_so_far(sweep.folder_of(record.trial))
            if record.rows and record.rows[-1]["steps"] >= record.trial.config.total_steps:
                record.state = "done"
            elif known.get("state") == "stopped":
                record.state = "stopped"

    @property
    def ranked(self) -> list[Record]:
        """Trials with the best first; those without scores are last."""
        return sorted(
            self.records.values(), key=lambda record: merit(record.best) if record.best else (-1.0, 0.0), reverse=True
        )

    @property
    def steps(self) -> int:
        """Control steps so far, of all trials together."""
        return sum(int(record.rows[-1]["steps"]) for record in self.records.values() if record.rows)

    @property
    def finished(self) -> bool:
        """Whether no trial is to go on."""
        return all(record.state in ("done", "stopped") for record in self.records.values())

    def write(self) -> None:
        """Write ``results.json`` and ``results.csv``."""
        write_json(self.sweep.folder / "results.json", self.document())
        write_text(self.sweep.folder / "results.csv", self.csv())

    def document(self) -> dict[str, Any]:
        """Everything, for JSON, the best trial first."""
        trials = [
            {
                "trial": record.trial.name,
                "folder": f"trials/{record.trial.name}",
                "state": record.state,
                "values": record.trial.values,
                "best": record.best,
                "last": record.rows[-1] if record.rows else None,
                "workers_lost": record.losses,
                **({"error": record.error} if record.error else {}),
            }
            for record in self.ranked
        ]
        return {"finished": self.finished, "trials": trials}

    def csv(self) -> str:
        """A line a trial, the best first: its settings, and its scores at its best checkpoint."""
        ranked, keys = self.ranked, self.sweep.keys
        columns = list(dict.fromkeys(name for record in ranked for name in (record.best or {})))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["trial", "state", *keys, *(f"best_{name}" for name in columns)])
        for record in ranked:
            values, best = record.trial.values, record.best or {}
            settings = [values.get(key, "") for key in keys]
            writer.writerow([record.trial.name, record.state, *settings, *(best.get(name, "") for name in columns)])
        return text.getvalue()

    def table(self) -> Table:
        """A row a trial, the best first."""
        keys = self.sweep.keys
        env_id = self.sweep.trials[0].config.env_id
        primary = card_of(env_id).primary
        rows = []
        for record in self.ranked:
            place = record.trial.name.partition("-")[0]
            settings = [value_text(record.trial.values.get(key, "")) for key in keys]
            steps = f"{int(record.rows[-1]['steps']):,}" if record.rows else ""
            scores = ["", "", *([""] if primary else [])]
            if best := record.best:
                scores = [percent_text(best["success"]), number_text(best["return"])]
                scores += [number_text(best[primary.key] * primary.factor)] if primary else []
            rows.append([place, *settings, record.state, steps, *scores])
        headers = ["trial", *keys, "state", "steps", "best success (%)", "its return"]
        headers += [f"its {primary.title}"] if primary else []
        caption = (
            "Scores at each trial's best checkpoint, by success, then by return, on the same episodes at every "
            "checkpoint: selected on them, so slightly optimistic."
        )
        return Table(env_id, headers, rows, caption, text_columns=2 + len(keys))


def _before(path: Path) -> dict[str, dict[str, Any]]:
    """The entries of the trials in the results of before, by name; none without."""
    if not path.is_file():
        return {}
    document = read_document(path, _MOST_BYTES)
    trials = document.get("trials", []) if isinstance(document, dict) else []
    return {str(trial.get("trial")): trial for trial in trials if isinstance(trial, dict)}
