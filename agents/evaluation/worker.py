"""What a worker of a spread benchmark does, and the workers of a benchmark."""

from __future__ import annotations

import json
from importlib import import_module
from typing import Any

from agents.cluster import Place
from agents.environments import own_modules
from agents.evaluation.benchmark import WARM_UP, Benchmark
from agents.evaluation.benchmark_config import BenchmarkConfig
from agents.evaluation.spread import Order, Piece, Workers

_BENCHMARKS: dict[Order, Benchmark] = {}
"""In a worker: the benchmark that it has done pieces of."""
_WARM: set[tuple[Order, str, str]] = set()
"""In a worker: the policies that have acted on a task, so that no time includes compilation."""


def workers_of(ray: Any, benchmark: Benchmark) -> Workers:
    """Workers for a benchmark whose policies are all names or paths, on the cluster that ``ray`` is connected to."""
    config = json.dumps(benchmark.config.model_dump(mode="json"))
    return Workers(ray, Order(config, benchmark.allow_code, Place.here(), own_modules()), do_piece)


def do_piece(order: Order, piece: Piece) -> Any:
    """In a worker: do a piece."""
    if order not in _BENCHMARKS:
        order.place.enter()
        for module in order.modules:
            import_module(module)
        config = BenchmarkConfig.parse(json.loads(order.config), "benchmark setting")
        _BENCHMARKS[order] = Benchmark(config, allow_code=order.allow_code)
    benchmark = _BENCHMARKS[order]
    warm = (order, piece.task, piece.policy)
    if piece.kind == "episodes" and warm not in _WARM:
        benchmark.do(Piece(piece.kind, piece.task, piece.policy, piece.seeds[:WARM_UP]))
        _WARM.add(warm)
    return benchmark.do(piece)
