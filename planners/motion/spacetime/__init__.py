"""A search in space and time: whether a two-link arm can reach a place among moving discs, and how soon."""

from planners.motion.spacetime.search import MARGIN, Answer, Verdict, search

__all__ = ["MARGIN", "Answer", "Verdict", "search"]
