"""A task's compiled kernels at work on ranges of a batch, on the caller's thread or on several.

The threads belong to the process, not to a batch, and run compiled code only: they neither take Python's lock nor
allocate, and no interrupt can end the caller's wait for them. Work is cut into slices, which the caller and its
helpers take one by one from a counter, so that a thread that comes late leaves its share to the others. Which thread
advances an environment has no effect on the result.
"""

from __future__ import annotations

import ctypes
import os
from _thread import start_new_thread
from typing import Any

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import njit, typeof, types
from numba.core import cgutils
from numba.core.callconv import RETCODE_USEREXC
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

from envs.batch.records import Records
from envs.physics.chipmunk import reals_at
from planners.compiled.calls import Kernel, address_of, inlined, private

Words = NDArray[np.int64]

KERNEL, BATCH, COUNT, MODEL, WORK, RESTING = range(6)
"""Words of a job: address of the kernel, address and number of the records, address of the model record, the
purpose of the call (`NO_PURPOSE` if the kernel takes none), and the address of a float64 for each environment
that is not 0 if it stays as it is, or 0 if all are worked on."""

NO_PURPOSE = -1
JOB_SIZE = 6

ENVS_PER_THREAD = 16
"""With fewer environments for each, waking another thread costs more than it brings."""

BEGIN_THREADS = 64
"""With fewer environments no threads are begun: to compile them takes longer than they save."""

ENVS_PER_SLICE, SLICES_PER_THREAD = 8, 4
"""Least environments that a thread takes at once, and the slices for each thread if there are enough of them. Slices
are multiples of 8, the environments that closed-form physics advances at once (`envs.physics.packs`)."""

_BUSY, _LEFT, _SLICES, _SLICE, _DONE, _WAITING, _FINISHED, _ERROR, _JOB = range(9)
_HELPERS = _JOB + JOB_SIZE
"""Words that the threads share; then for each helper its lock, and whether it sleeps."""

_START: Any = np.int64(0)  # no literal: for each of these Numba would compile once more
_SHARED_JOB: Any = np.int64(_JOB)


def _python_function(name: str, result: Any, *arguments: Any) -> Any:
    """A function of Python's C interface that does not need Python's lock, callable from compiled code."""
    symbol, place = f"planarm_{name}", ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value
    llvmlite.binding.add_symbol(symbol, place)
    return types.ExternalFunction(symbol, result(*arguments))


_take_lock = _python_function("PyThread_acquire_lock", types.int32, types.intp, types.int32)
_give_lock = _python_function("PyThread_release_lock", types.void, types.intp)


def _atomic(operation: str) -> Any:
    """An atomic operation on one of the words that threads share; it returns the word from before."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        words = context.make_array(signature.args[0])(context, builder, values[0])
        return builder.atomic_rmw(operation, builder.gep(words.data, [values[1]]), values[2], "seq_cst")

    @intrinsic
    def atomic(typing_context: Any, words: Any, index: Any, value: Any) -> Any:
        return types.int64(words, types.int64, types.int64), build

    return atomic


_add, _exchange = _atomic("add"), _atomic("xchg")


def _attempt(typing_context: Any, kernel: Any, batch: Any, count: Any, model: Any, *purpose: Any) -> Any:
    """Call a kernel, ``kernel(batch, model, *purpose)``; the address of the error that it raises, or 0."""
    # To the calling convention, an array of records is like one of numbers.
    records = types.Array(types.float64, 1, "C")
    given = (records, records, *[types.int64] * len(purpose))

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        address, place, length, shared, purpose = values
        word = ir.IntType(64)

        def array(data: Any, size: Any) -> Any:
            made = context.make_array(records)(context, builder)
            pointer = builder.inttoptr(data, ir.DoubleType().as_pointer())
            populate_array(made, pointer, [size], [word(8)], word(8), None)  # type: ignore[no-untyped-call]
            return made._getvalue()

        convention = context.call_conv
        status, _ = convention.call_function(
            builder,
            builder.inttoptr(address, convention.get_function_type(types.void, given).as_pointer()),
            types.void,
            given,
            [array(place, length), array(shared, word(1)), *cgutils.unpack_tuple(builder, purpose)],  # type: ignore[no-untyped-call]
        )
        return builder.select(status.is_error, builder.ptrtoint(status.excinfoptr, word), word(0))

    return types.int64(kernel, batch, count, model, types.StarArgTuple.from_types([types.int64] * len(purpose))), build  # type: ignore[no-untyped-call]


def _raise_error(typing_context: Any, error: Any) -> Any:
    """Raise the error at an address, which a kernel has raised on any thread; nothing if that is 0."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = context.call_conv._get_excinfo_argument(builder.function)
        with cgutils.if_unlikely(builder, builder.icmp_signed("!=", values[0], ir.IntType(64)(0))):  # type: ignore[no-untyped-call]
            builder.store(builder.inttoptr(values[0], place.type.pointee), place)
            builder.ret(RETCODE_USEREXC)
        return context.get_dummy_value()

    return types.void(types.int64), build


_attempted: Any = intrinsic(_attempt)
_raise: Any = intrinsic(_raise_error)


@inlined
def _work_on(words: Any, job: int, first: int, last: int) -> int:
    """Work on environments ``first`` to ``last - 1``; the address of an error, or 0."""
    kernel, batch, count, model = words[job + KERNEL], words[job + BATCH], words[job + COUNT], words[job + MODEL]
    if words[job + WORK] == NO_PURPOSE:
        error: int = _attempted(kernel, batch, count, model, first, last)
    else:
        error = _attempted(kernel, batch, count, model, first, last, words[job + WORK])
    return error


@private
def _work_on_range(words: Any, job: int, first: int, last: int) -> int:
    """The same, but for environments that rest; the words of the job begin at ``job``."""
    address, index, error = words[job + RESTING], first, 0
    resting = reals_at(address)
    while index < last and error == 0:
        end = last if address == 0 else index
        while end < last and resting[end] == 0.0:
            end += 1
        if end > index:  # none of these rests; the next one does
            error = _work_on(words, job, index, end)
        index = end + 1
    return error


@njit(cache=True, nogil=True)
def work(job: Words, first: int, last: int) -> None:
    """Let a job's kernel work on environments ``first`` to ``last - 1``, on this thread."""
    _raise(_work_on_range(job, _START, first, last))


@njit(cache=True, nogil=True)
def _work_together(words: Words, job: Words, helpers: int, size: int) -> None:
    """Let a job's kernel work on all environments, in slices of ``size``, with the help of other threads.

    If these help somebody else, this thread does all of it.
    """
    count = job[COUNT]
    if _exchange(words, _BUSY, 1) == 1:
        _raise(_work_on_range(job, _START, _START, count))
        return
    for word in range(JOB_SIZE):
        words[_JOB + word] = job[word]
    slices = (count + size - 1) // size
    words[_SLICE], words[_SLICES], words[_ERROR] = size, slices, 0
    _exchange(words, _DONE, 0)
    _exchange(words, _LEFT, slices)  # from here on a helper may take one
    for helper in range(helpers):
        if _exchange(words, _HELPERS + 2 * helper + 1, 0) == 1:
            _give_lock(words[_HELPERS + 2 * helper])
    _take_slices(words)
    while True:
        _exchange(words, _WAITING, 1)
        if _add(words, _DONE, 0) == slices and _exchange(words, _WAITING, 0) == 1:
            break
        _take_lock(words[_FINISHED], 1)  # given by the thread that has found this thread waiting
        if _add(words, _DONE, 0) == slices:
            break
    error = words[_ERROR]
    _exchange(words, _BUSY, 0)
    _raise(error)


@private
def _take_slices(words: Any) -> None:
    """Work on slices until none is left."""
    while True:
        left = _add(words, _LEFT, -1)
        if left <= 0:
            return
        # As long as this slice is not done, the job is the same.
        slices, size = words[_SLICES], words[_SLICE]
        first = (slices - left) * size
        error = _work_on_range(words, _SHARED_JOB, first, min(words[_JOB + COUNT], first + size))
        if error != 0:
            words[_ERROR] = error
        if _add(words, _DONE, 1) + 1 == slices and _exchange(words, _WAITING, 0) == 1:
            _give_lock(words[_FINISHED])


@njit(cache=True, nogil=True)
def _help(words: Words, helper: int) -> None:
    """Work on slices of whatever there is, for ever."""
    lock, asleep = words[_HELPERS + 2 * helper], _HELPERS + 2 * helper + 1
    while True:
        _exchange(words, asleep, 1)
        if _add(words, _LEFT, 0) <= 0 or _exchange(words, asleep, 0) == 0:
            _take_lock(lock, 1)
        _take_slices(words)


def job_of(kernel: Any, records: Records, model: Records, purpose: int = NO_PURPOSE) -> Words:
    """The job of a kernel, a `planners.compiled.calls.Kernel` or what ``numba.njit`` returns, with these records."""
    numbers = [types.int64] * (2 if purpose == NO_PURPOSE else 3)
    kinds = typeof(records), typeof(model), *numbers  # type: ignore[no-untyped-call]
    job = np.zeros(JOB_SIZE, np.int64)
    job[KERNEL] = kernel.address(*kinds) if isinstance(kernel, Kernel) else address_of(kernel, *kinds)
    job[BATCH], job[MODEL] = records.ctypes.data, model.ctypes.data
    job[COUNT], job[WORK] = len(records), purpose
    return job


def cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Pool:
    """Threads that help the caller who advances a batch, one batch at a time.

    Args:
        threads: number of threads, with that of the caller.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._words = np.zeros(_HELPERS + 2 * threads, np.int64)
        self._words[_FINISHED] = _taken_lock()
        _help.compile((types.int64[::1], types.int64))
        for helper in range(threads - 1):
            self._words[_HELPERS + 2 * helper] = _taken_lock()
            start_new_thread(_help, (self._words, helper))

    def work(self, job: Words, envs_per_thread: int = ENVS_PER_THREAD) -> None:
        """Let a job's kernel work on all environments; each thread that helps has at least so many."""
        count = int(job[COUNT])
        threads = min(self.threads, count // envs_per_thread)
        if threads < 2:
            work(job, 0, count)
        else:
            least, size = min(ENVS_PER_SLICE, envs_per_thread), -(-count // (SLICES_PER_THREAD * threads))
            size = max(least, size + -size % least)
            _work_together(self._words, job, threads - 1, size)


def _taken_lock() -> int:
    """A lock of Python's, which lives as long as the process; taken."""
    allocate = ctypes.pythonapi.PyThread_allocate_lock
    allocate.restype, take = ctypes.c_void_p, ctypes.pythonapi.PyThread_acquire_lock
    take.argtypes = ctypes.c_void_p, ctypes.c_int
    lock = allocate()
    take(lock, 1)
    return int(lock)


_pools: list[Pool] = []


def shared_pool() -> Pool:
    """The threads of this process, begun when they are first needed; they do not survive a fork."""
    if not _pools:
        _pools.append(Pool(cores()))
    return _pools[0]


def work_on_all(job: Words, count: int, envs_per_thread: int = ENVS_PER_THREAD) -> None:
    """Let a job's kernel work on all of so many environments, with the threads of this process if they are many."""
    if count < (2 * envs_per_thread if _pools else BEGIN_THREADS):
        work(job, 0, count)
    else:
        shared_pool().work(job, envs_per_thread)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pools.clear)
